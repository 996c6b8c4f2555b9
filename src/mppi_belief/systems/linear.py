"""A linear-Gaussian system of any size (Proposition 2).

dx = (A x + B u) dt + H dw,      dy = C x dt + sigma_o dnu
"""

import jax.numpy as jnp
from jax import Array

from ..structs import ArrayField, array, struct


@struct
class Linear:
    """Represents a linear system of nx states, nu controls, ny measurements, nw noise channels."""

    A: ArrayField = array(ndim=2)  # (nx, nx)
    B: ArrayField = array(ndim=2)  # (nx, nu)
    C: ArrayField = array(ndim=2)  # (ny, nx)
    channel: ArrayField = array(ndim=2)  # H (nx, nw)
    sensor_noise: ArrayField = array(ndim=1, gt=0)  # the diagonal of sigma_o (ny,)

    @property
    def H(self) -> Array:
        return jnp.asarray(self.channel)

    def f(self, x: Array) -> Array:
        return jnp.asarray(self.A) @ x

    def G(self, x: Array) -> Array:
        return jnp.asarray(self.B)

    def c(self, x: Array) -> Array:
        return jnp.asarray(self.C) @ x

    def sigma_o(self, x: Array) -> Array:
        return jnp.diag(jnp.asarray(self.sensor_noise))
