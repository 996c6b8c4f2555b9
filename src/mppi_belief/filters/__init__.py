"""Filters, one file each."""

from .ekf import EKF
from .mixture import MixtureFilter
from .particle import ParticleFilter
from .ukf import UKF

__all__ = ["EKF", "UKF", "MixtureFilter", "ParticleFilter"]
