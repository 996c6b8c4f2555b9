"""Obstacles, one shape per file."""

from .discs import Obstacles

__all__ = ["Obstacles"]
