"""Filters, one file each."""

from .ekf import EKF

__all__ = ["EKF"]
