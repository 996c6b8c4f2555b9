"""Obstacles, one shape per file, and what a cost may ask of them."""

from .discs import Obstacles
from .segments import ClosedFormClearance
from .surroundings import ObstacleShape, Surroundings

__all__ = ["ClosedFormClearance", "ObstacleShape", "Obstacles", "Surroundings"]
