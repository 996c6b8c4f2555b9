"""Filters, one file each."""

from .ekf import EKF
from .particle import ParticleFilter

__all__ = ["EKF", "ParticleFilter"]
