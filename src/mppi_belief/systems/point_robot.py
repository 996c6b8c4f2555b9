"""A point robot in the plane whose velocity is controlled and whose position sensor needs light: the light-dark domain
of Platt et al. (2010), which van den Berg et al. (2012) use as well.

    p' = u + sigma_w w',  y = p + sigma_o(p_x) v,  q(p_x) = curvature (p_x - light)^2 + floor

With `noise_law: variance` q is the variance of a measurement, sigma_o^2 = q, with `deviation` its standard deviation,
sigma_o = q. State [p_x, p_y] in m, control a velocity in m/s, measurement in m.
"""

import jax.numpy as jnp
from jax import Array

from ..obstacles import Obstacles
from ..pytree import choice, number, struct


@struct
class PointRobot:
    """A planar single integrator; curvature and floor in the units of `noise_law`: no unit and m^2, or 1/m and m."""

    obstacles: Obstacles
    process_noise: float = number(ge=0)  # sigma_w, m/s^0.5
    light: float = number()  # m
    noise_curvature: float = number(ge=0)
    noise_floor: float = number(gt=0)
    noise_law: str = choice("variance", "deviation")
    noise_convention: str = choice("sample", "intensity")

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
        q = self.noise_curvature * (x[0] - self.light) ** 2 + self.noise_floor
        return (jnp.sqrt(q) if self.noise_law == "variance" else q) * jnp.eye(2)

    def position(self, x: Array) -> Array:
        return x

    def clearance(self, x: Array) -> Array:
        return self.obstacles.clearance(x)
