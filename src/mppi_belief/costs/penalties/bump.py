"""A Gaussian bump about the centre of every obstacle.

    h(p - z) = exp(-|p - z|^2 / (2 l^2))

It has no edge: its width decides how far it reaches, and the radius of an obstacle does not enter.
"""

from jax import Array

from ...belief.moments import bump_sum, bump_sum_moments, quadratic_bump_covariance
from ...structs import number, struct


@struct
class Bump:
    """Adds a Gaussian bump at the centre of every obstacle, with moments in closed form."""

    width: float = number(default=1.0, gt=0)  # l, m

    def sum_about(self, position: Array, centers: Array) -> Array:
        """Returns the sum () of bumps at centers (n, d), at one position (d or more,)."""
        return bump_sum(position, centers, self.width)

    def moments_about(self, mean: Array, cov: Array, centers: Array) -> tuple[Array, Array]:
        """Returns expectation and variance, both (), of the sum of bumps at centers (n, d)."""
        return bump_sum_moments(mean, cov, centers, self.width)

    def covariance_about(
        self, mean: Array, cov: Array, reference: Array, weight: Array, centers: Array
    ) -> Array:
        """Returns the covariance () of the quadratic with the sum of bumps."""
        return quadratic_bump_covariance(mean, cov, reference, weight, centers, self.width)
