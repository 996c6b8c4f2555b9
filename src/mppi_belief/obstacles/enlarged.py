"""Obstacles that are enlarged on all sides, whatever their shape.

    d_j(p) - reach

is the distance of a position p to obstacle j with a border of this width around it. A penalty that
falls with the distance is then the worst within `reach` of the position, for each obstacle. Of
penalties about centres, which know no surface, it is the worst too: centres are moved towards the
position by `reach`, and to the position itself where they are nearer than that.
"""

from dataclasses import dataclass

import jax.numpy as jnp
from jax import Array

from .distances import obstacle_distances
from .surroundings import ObstacleShape, Surroundings


def enlarge(surroundings: Surroundings, reach: Array) -> Surroundings:
    """Returns the surroundings with obstacles that are enlarged by `reach` ()."""
    if surroundings.obstacles is None:
        return surroundings
    return surroundings._replace(obstacles=EnlargedObstacles(surroundings.obstacles, reach))


@dataclass(frozen=True)
class EnlargedObstacles:
    """Represents obstacles with a border around each of them."""

    shape: ObstacleShape  # the obstacles without it
    reach: Array  # (), m, at least 0: the width of the border

    def clearance(self, position: Array) -> Array:
        """Returns the distance () from a position (d,) to the nearest border."""
        return self.shape.clearance(position) - self.reach

    def distances(self, position: Array) -> Array:
        """Returns the distance (n,) from a position (d,) to the border of each obstacle."""
        return obstacle_distances(self.shape, position) - self.reach

    @property
    def centers(self) -> Array:
        """Returns the centres (n, d) of the obstacles; raises `AttributeError` without."""
        return jnp.asarray(self.shape.centers)  # type: ignore[attr-defined]

    def centers_towards(self, position: Array) -> Array:
        """Returns the centres (n, d), each moved by `reach` towards a position (d,)."""
        centers = self.centers
        offsets = position - centers
        squares = jnp.sum(offsets**2, axis=-1, keepdims=True)

        # The root has no derivative at a centre, which is not moved.
        apart = squares > 0
        distances = jnp.sqrt(jnp.where(apart, squares, 1.0))
        return centers + jnp.minimum(self.reach / distances, 1.0) * offsets
