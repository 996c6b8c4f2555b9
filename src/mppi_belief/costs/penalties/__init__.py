"""Penalties on obstacles, one shape per file."""

from .bump import Bump
from .hinge import Hinge
from .indicator import Indicator
from .protocols import (
    CenterPenalty,
    DistancePenalty,
    ObstaclePenalty,
    SurfacePenalty,
)
from .smooth_step import SmoothStep
from .squared_hinge import SquaredHinge

__all__ = [
    "Bump",
    "CenterPenalty",
    "DistancePenalty",
    "Hinge",
    "Indicator",
    "ObstaclePenalty",
    "SmoothStep",
    "SquaredHinge",
    "SurfacePenalty",
]
