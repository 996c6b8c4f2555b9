"""A penalty that rises smoothly from 0 at the margin of an obstacle to 1 at its surface.

h(d) = 3 t^2 - 2 t^3,   t = clip((m - d) / m, 0, 1)
"""

import jax.numpy as jnp
from jax import Array

from ...structs import number, struct


@struct
class SmoothStep:
    """Charges 1 inside every obstacle, falling to 0 over a margin around it."""

    margin: float = number(gt=0)  # m, around the surface

    def profile(self, distance: Array) -> Array:
        """Returns the penalty (0 to 1) at a distance (m) to a surface, of any shape."""
        t = jnp.clip(1.0 - distance / self.margin, 0.0, 1.0)
        return t * t * (3.0 - 2.0 * t)
