"""A penalty that grows with the square of the depth inside the margin of an obstacle.

h(d) = max(0, m - d)^2
"""

import jax.numpy as jnp
from jax import Array

from ...structs import number, struct


@struct
class SquaredHinge:
    """Charges the squared depth (m^2) below a margin around every obstacle, nothing beyond it."""

    margin: float = number(default=0.0, ge=0)  # m, around the surface

    def profile(self, distance: Array) -> Array:
        """Returns the penalty (m^2) at a distance (m) to a surface, of any shape."""
        return jnp.maximum(self.margin - distance, 0.0) ** 2
