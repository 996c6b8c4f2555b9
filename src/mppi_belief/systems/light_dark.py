"""The light-dark double integrator of Sec. VII.

    p' = v,   v' = u + sigma_w w'
    y  = p + sigma_o(p_x) v,    sigma_o(p_x) = slope |p_x - light| + floor

State [p_x, p_y, v_x, v_y] in m and m/s, control an acceleration in m/s^2, measurement in m.
"""

import jax.numpy as jnp
from jax import Array

from ..structs import number, struct


@struct
class LightDark:
    """Represents a planar double integrator whose position sensor is best at p_x = light."""

    process_noise: float = number(ge=0)  # sigma_w, m/s^1.5
    light: float = number()  # x_light, m
    noise_slope: float = number(ge=0)  # m/m
    noise_floor: float = number(gt=0)  # m

    state_labels = ("$p_x$ (m)", "$p_y$ (m)", "$v_x$ (m/s)", "$v_y$ (m/s)")
    measurement_units = ("m", "m")

    @property
    def H(self) -> Array:
        return jnp.vstack([jnp.zeros((2, 2)), self.process_noise * jnp.eye(2)])

    def f(self, x: Array) -> Array:
        return jnp.concatenate([x[2:], jnp.zeros_like(x[:2])])

    def G(self, x: Array) -> Array:
        return jnp.vstack([jnp.zeros((2, 2)), jnp.eye(2)])

    def c(self, x: Array) -> Array:
        return x[:2]

    def sigma_o(self, x: Array) -> Array:
        return (self.noise_slope * jnp.abs(x[0] - self.light) + self.noise_floor) * jnp.eye(2)
