"""A penalty that grows linearly with the depth inside the margin of an obstacle.

h(d) = max(0, m - d)

Under d ~ N(a, s^2), with z = (m - a) / s and the distribution function P and density p of a
standard normal at z, and Q = 1 - P:

    E[h]   = s (p + z P)
    Var[h] = s^2 (P + z^2 P Q + z p (Q - P) - p^2)      without the difference E[h^2] - E[h]^2
"""

import jax.numpy as jnp
from jax import Array

from ...belief.half_space_moments import DistanceMoments
from ...belief.interval_rule import normal_cdf, normal_pdf
from ...structs import number, struct


@struct
class Hinge:
    """Charges the depth (m) below a margin around every obstacle, and nothing beyond it."""

    margin: float = number(default=0.0, ge=0)  # m, around the surface

    def profile(self, distance: Array) -> Array:
        """Returns the penalty (m) at a distance (m) to a surface, of any shape."""
        return jnp.maximum(self.margin - distance, 0.0)

    @property
    def reach(self) -> float:
        """Returns the distance (m) from which on there is no penalty."""
        return self.margin

    def distance_moments(self, mean: Array, sd: Array) -> DistanceMoments:
        """Returns the moments for a distance d ~ N(mean, sd^2), sd > 0."""
        z = (self.margin - mean) / sd
        inside = normal_cdf(z)
        outside = normal_cdf(-z)
        density = normal_pdf(z)
        expectation = sd * density + (self.margin - mean) * inside
        scaled = inside + z * z * inside * outside + z * density * (outside - inside) - density**2
        return DistanceMoments(
            jnp.maximum(expectation, 0.0),
            sd**2 * jnp.maximum(scaled, 0.0),
            -inside,
            density / sd,
        )
