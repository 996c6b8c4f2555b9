"""A penalty that grows with the square of the depth inside the margin of an obstacle.

h(d) = max(0, m - d)^2

Under d ~ N(a, s^2), with z = (m - a) / s and the distribution function P and density p of a
standard normal at z, and Q = 1 - P:

    E[h]   = s^2 ((1 + z^2) P + z p)
    Var[h] = s^4 (P (2 + 4 z^2 + (1 + z^2)^2 Q) + z p (3 - z^2 + 2 (1 + z^2) Q - z p))

The variance is written without the difference E[h^2] - E[h]^2, in which z^4 would cancel.
"""

import jax.numpy as jnp
from jax import Array

from ...belief.half_space_moments import DistanceMoments
from ...belief.interval_rule import normal_cdf, normal_pdf
from ...structs import number, struct


@struct
class SquaredHinge:
    """Charges the squared depth (m^2) below a margin around every obstacle, nothing beyond it."""

    margin: float = number(default=0.0, ge=0)  # m, around the surface

    def profile(self, distance: Array) -> Array:
        """Returns the penalty (m^2) at a distance (m) to a surface, of any shape."""
        return jnp.maximum(self.margin - distance, 0.0) ** 2

    @property
    def reach(self) -> float:
        """Returns the distance (m) from which on there is no penalty."""
        return self.margin

    def distance_moments(self, mean: Array, sd: Array) -> DistanceMoments:
        """Returns the moments for a distance d ~ N(mean, sd^2), sd > 0."""
        depth = self.margin - mean
        z = depth / sd
        square = z * z
        inside = normal_cdf(z)
        outside = normal_cdf(-z)
        density = normal_pdf(z)
        expectation = (sd**2 + depth**2) * inside + sd * depth * density
        scaled = inside * (2 + 4 * square + (1 + square) ** 2 * outside) + z * density * (
            3 - square + 2 * (1 + square) * outside - z * density
        )
        return DistanceMoments(
            jnp.maximum(expectation, 0.0),
            sd**4 * jnp.maximum(scaled, 0.0),
            -2 * (sd * density + depth * inside),
            2 * inside,
        )
