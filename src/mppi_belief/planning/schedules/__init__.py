"""How the covariance along a path is planned, one file each."""

from .per_path import PerPathCovariance
from .shared import SharedCovariance

__all__ = ["PerPathCovariance", "SharedCovariance"]
