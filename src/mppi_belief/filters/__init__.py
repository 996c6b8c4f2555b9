"""Filters, one file each."""

from .ekf import EKF
from .mixture import MixtureFilter
from .particle import ParticleFilter

__all__ = ["EKF", "MixtureFilter", "ParticleFilter"]
