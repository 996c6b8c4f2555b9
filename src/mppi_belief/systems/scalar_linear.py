"""The scalar linear-Gaussian system of Remark 2, where belief-space path integral control is exact.

dx = (a x + b u) dt + sigma_w dw,      dy = c x dt + sigma_o dnu
"""

import jax.numpy as jnp
from jax import Array

from ..structs import number, struct


@struct
class ScalarLinear:
    """Represents a linear system with one state, one control and one measurement."""

    drift: float = number()  # a
    control_gain: float = number()  # b
    sensor_gain: float = number()  # c
    process_noise: float = number(ge=0)  # sigma_w
    sensor_noise: float = number(gt=0)  # sigma_o

    @property
    def H(self) -> Array:
        return jnp.reshape(jnp.asarray(self.process_noise, dtype=float), (1, 1))

    def f(self, x: Array) -> Array:
        return self.drift * x

    def G(self, x: Array) -> Array:
        return jnp.reshape(jnp.asarray(self.control_gain, dtype=float), (1, 1))

    def c(self, x: Array) -> Array:
        return self.sensor_gain * x

    def sigma_o(self, x: Array) -> Array:
        return jnp.reshape(jnp.asarray(self.sensor_noise, dtype=float), (1, 1))
