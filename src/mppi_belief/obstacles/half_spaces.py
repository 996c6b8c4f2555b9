"""Walls: half-spaces of positions."""

import jax.numpy as jnp
import numpy as np
from jax import Array

from ..structs import ArrayField, array, struct


@struct
class HalfSpaces:
    """Represents walls: a position p is inside wall j where normal_j' p < offset_j.

    Normals point out of the walls and need not have unit length: both are divided by it, as
    2 x > 6 is x > 3.

    Raises:
        ValueError: for a normal that is zero, or another number of offsets
    """

    normals: ArrayField = array(ndim=2)  # (n, d), outward
    offsets: ArrayField = array(ndim=1)  # (n,), m for unit normals

    def __post_init__(self) -> None:
        """Makes normals unit vectors."""
        if not isinstance(self.normals, np.ndarray) or not isinstance(self.offsets, np.ndarray):
            return  # traced: checked when the object was first made
        if len(self.offsets) != len(self.normals):
            raise ValueError(
                f"offsets must be one per normal, got {len(self.offsets)} for {len(self.normals)}"
            )
        lengths = np.sqrt(np.sum(self.normals**2, axis=-1))
        if not np.all(lengths > 0):
            zero = int(np.argmin(lengths))
            raise ValueError(f"normals must not be zero, got {self.normals[zero].tolist()}")
        object.__setattr__(self, "normals", self.normals / lengths[:, None])
        object.__setattr__(self, "offsets", self.offsets / lengths)

    def clearance(self, position: Array) -> Array:
        """Returns the distance () from a position (d,) to the nearest wall.

        It is negative inside, and inf without walls. Raises `ValueError` for another d.
        """
        return jnp.min(self.distances(position), initial=jnp.inf)

    def distances(self, position: Array) -> Array:
        """Returns the distance (n,) from a position (d,) to each wall, negative inside.

        Raises `ValueError` for another d.
        """
        normals = jnp.asarray(self.normals)
        if len(normals) == 0:
            return jnp.zeros(0)
        if normals.shape[-1] != len(position):
            raise ValueError(
                f"normals of shape {normals.shape} do not fit a position of {len(position)}"
            )
        return jnp.sum(normals * position, axis=-1) - self.offsets

    def segment_clearance(self, start: Array, end: Array) -> Array:
        """Returns the least clearance () on the straight line between two positions (d,).

        A distance to a wall is linear along the line, so it is that of one of its ends.
        """
        return jnp.minimum(self.clearance(start), self.clearance(end))
