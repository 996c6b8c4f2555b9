"""Obstacles, one shape per file, and what a cost may ask of them."""

from .discs import Obstacles
from .distances import ObstacleDistances, obstacle_distances
from .segments import ClosedFormClearance
from .surroundings import ObstacleShape, Surroundings

__all__ = [
    "ClosedFormClearance",
    "ObstacleDistances",
    "ObstacleShape",
    "Obstacles",
    "Surroundings",
    "obstacle_distances",
]
