"""Round obstacles in the space of positions."""

import jax.numpy as jnp
from jax import Array

from ..structs import ArrayField, array, number, struct


@struct
class Obstacles:
    """Represents discs (spheres, intervals) of one radius."""

    centers: ArrayField = array(ndim=2)  # (n, d), m; n may be zero
    radius: float = number(ge=0)  # m

    def clearance(self, position: Array) -> Array:
        """Returns the distance () from a position (d,) to the nearest surface.

        It is negative inside, and inf without discs. Raises `ValueError` for another d.
        """
        if len(self.centers) == 0:
            return jnp.asarray(jnp.inf)
        if self.centers.shape[-1] != len(position):
            raise ValueError(
                f"centers of shape {self.centers.shape} do not fit a position of {len(position)}"
            )
        offsets = position - jnp.asarray(self.centers)
        return jnp.min(jnp.sqrt(jnp.sum(offsets**2, axis=-1))) - self.radius
