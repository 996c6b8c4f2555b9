"""Defines what a penalty on obstacles may be.

    penalty(p) = w_obs sum_j h(d_j(p))

with the distance d_j of the position p to the surface of obstacle j, negative inside, and a profile
h of this distance (`SurfacePenalty`). A profile about a centre (`CenterPenalty`) takes the position
less the centre instead of the distance.
"""

from typing import Protocol, TypeAlias, runtime_checkable

from jax import Array

from ...belief.half_space_moments import DistanceMoments


@runtime_checkable
class SurfacePenalty(Protocol):
    """Represents a penalty on the distance to the surface of an obstacle."""

    def profile(self, distance: Array) -> Array:
        """Returns the penalty per second and unit weight at a distance (m): () -> ().

        The distance is negative inside the obstacle.
        """


@runtime_checkable
class DistancePenalty(SurfacePenalty, Protocol):
    """Adds to a penalty its moments under a Gaussian distance, for exact moments at walls."""

    @property
    def reach(self) -> float:
        """Returns the distance (m) from which on there is no penalty."""

    def distance_moments(self, mean: Array, sd: Array) -> DistanceMoments:
        """Returns the moments for a distance ~ N(mean, sd^2), both (), sd > 0."""


@runtime_checkable
class CenterPenalty(Protocol):
    """Represents a penalty about the centres of obstacles."""

    def sum_about(self, position: Array, centers: Array) -> Array:
        """Returns the sum () over centres (n, d) at a position, the first d of the components."""

    def moments_about(self, mean: Array, cov: Array, centers: Array) -> tuple[Array, Array]:
        """Returns expectation and variance, both (), of the sum over centres (n, d).

        The position is the first d components of the state N(mean (nx,), cov (nx, nx)).
        """

    def covariance_about(
        self, mean: Array, cov: Array, reference: Array, weight: Array, centers: Array
    ) -> Array:
        """Returns the covariance () of the sum with 1/2 (x - reference)' weight (x - reference)."""


ObstaclePenalty: TypeAlias = SurfacePenalty | CenterPenalty
