"""Obstacles, one shape per file, and what a cost may ask of them."""

from .discs import Obstacles
from .distances import ObstacleDistances, is_plain, obstacle_distances
from .half_spaces import HalfSpaces
from .segments import ClosedFormClearance
from .surroundings import ObstacleShape, Surroundings

__all__ = [
    "ClosedFormClearance",
    "HalfSpaces",
    "ObstacleDistances",
    "ObstacleShape",
    "Obstacles",
    "Surroundings",
    "is_plain",
    "obstacle_distances",
]
