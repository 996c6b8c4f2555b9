"""A penalty of 1 within the margin of an obstacle: its expectation is a probability.

h(d) = 1 where d < m, else 0
"""

import jax.numpy as jnp
from jax import Array

from ...structs import number, struct


@struct
class Indicator:
    """Charges 1 below a margin around every obstacle, and nothing beyond it."""

    margin: float = number(default=0.0, ge=0)  # m, around the surface

    def profile(self, distance: Array) -> Array:
        """Returns 1 or 0 at a distance (m) to a surface, of any shape."""
        return jnp.where(distance < self.margin, jnp.ones_like(distance), 0.0)
