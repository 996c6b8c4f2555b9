"""Plans the covariance along a path: one schedule per file."""

from .per_path import PerPathCovariance
from .shared import SharedCovariance

__all__ = ["PerPathCovariance", "SharedCovariance"]
