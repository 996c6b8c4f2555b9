"""Round obstacles in the space of positions."""

import jax.numpy as jnp
from jax import Array

from ..structs import ArrayField, array, number, struct


@struct
class Obstacles:
    """Discs (spheres) of one radius; centers (n, d) in metres, n may be zero."""

    centers: ArrayField = array(ndim=2)
    radius: float = number(ge=0)

    def clearance(self, position: Array) -> Array:
        """Distance from a position (d,) to the nearest surface, negative inside, inf without obstacles."""
        if len(self.centers) == 0:
            return jnp.asarray(jnp.inf)
        if self.centers.shape[-1] != len(position):
            raise ValueError(
                f"centers of shape {self.centers.shape} do not fit a position of {len(position)}"
            )
        offsets = position - jnp.asarray(self.centers)
        return jnp.min(jnp.sqrt(jnp.sum(offsets**2, axis=-1))) - self.radius
