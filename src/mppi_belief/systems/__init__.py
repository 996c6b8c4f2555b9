"""Systems (1a)(1b), one file each."""

from .light_dark import LightDark
from .linear import Linear
from .scalar_linear import ScalarLinear
from .steered import Steered

__all__ = ["LightDark", "Linear", "ScalarLinear", "Steered"]
