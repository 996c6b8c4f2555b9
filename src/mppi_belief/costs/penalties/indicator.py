"""A penalty of 1 within the margin of an obstacle: its expectation is a probability.

h(d) = 1 where d < m, else 0

Under d ~ N(a, s^2), E[h] = P and Var[h] = P (1 - P) with the distribution function P of a standard
normal at (m - a) / s.
"""

import jax.numpy as jnp
from jax import Array

from ...belief.half_space_moments import DistanceMoments
from ...belief.interval_rule import normal_cdf, normal_pdf
from ...structs import number, struct


@struct
class Indicator:
    """Charges 1 below a margin around every obstacle, and nothing beyond it."""

    margin: float = number(default=0.0, ge=0)  # m, around the surface

    def profile(self, distance: Array) -> Array:
        """Returns 1 or 0 at a distance (m) to a surface, of any shape."""
        return jnp.where(distance < self.margin, jnp.ones_like(distance), 0.0)

    @property
    def reach(self) -> float:
        """Returns the distance (m) from which on there is no penalty."""
        return self.margin

    def distance_moments(self, mean: Array, sd: Array) -> DistanceMoments:
        """Returns the moments for a distance d ~ N(mean, sd^2), sd > 0."""
        z = (self.margin - mean) / sd
        inside = normal_cdf(z)
        density = normal_pdf(z)
        return DistanceMoments(inside, inside * normal_cdf(-z), -density / sd, -z * density / sd**2)
