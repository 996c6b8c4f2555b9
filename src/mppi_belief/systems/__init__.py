"""Systems (1a)(1b), one file each."""

from .light_dark import LightDark
from .scalar_linear import ScalarLinear

__all__ = ["LightDark", "ScalarLinear"]
