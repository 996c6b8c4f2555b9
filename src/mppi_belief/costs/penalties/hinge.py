"""A penalty that grows linearly with the depth inside the margin of an obstacle.

h(d) = max(0, m - d)
"""

import jax.numpy as jnp
from jax import Array

from ...structs import number, struct


@struct
class Hinge:
    """Charges the depth (m) below a margin around every obstacle, and nothing beyond it."""

    margin: float = number(default=0.0, ge=0)  # m, around the surface

    def profile(self, distance: Array) -> Array:
        """Returns the penalty (m) at a distance (m) to a surface, of any shape."""
        return jnp.maximum(self.margin - distance, 0.0)
