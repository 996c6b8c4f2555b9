"""A point robot in the plane whose velocity is controlled and whose position is measured.

This is the light-dark domain of Platt, Tedrake, Kaelbling and Lozano-Perez (RSS 2010): measurements
are best in the light.

    p' = u + sigma_w w'
    y  = p + sigma_o(p_x) v,    sigma_o(p_x)^2 = curvature (p_x - light)^2 + floor

State [p_x, p_y] in m, control a velocity in m/s, measurement in m.
"""

import jax.numpy as jnp
from jax import Array

from ..structs import number, struct


@struct
class PointRobot:
    """Represents a planar single integrator.

    The variance of its measurements is quadratic in the distance to the light.
    """

    process_noise: float = number(ge=0)  # sigma_w, m/s^0.5
    light: float = number()  # m
    noise_curvature: float = number(ge=0)  # m^2/m^2
    noise_floor: float = number(gt=0)  # m^2

    state_labels = ("$p_x$ (m)", "$p_y$ (m)")
    measurement_units = ("m", "m")

    @property
    def H(self) -> Array:
        return self.process_noise * jnp.eye(2)

    def f(self, x: Array) -> Array:
        return jnp.zeros_like(x)

    def G(self, x: Array) -> Array:
        return jnp.eye(2)

    def c(self, x: Array) -> Array:
        return x

    def sigma_o(self, x: Array) -> Array:
        variance = self.noise_curvature * (x[0] - self.light) ** 2 + self.noise_floor
        return jnp.sqrt(variance) * jnp.eye(2)
