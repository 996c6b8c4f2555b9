"""A pendulum seen from the side: its angle through a sine, beside a stop that it must not touch.

    a' = r,  r' = u - g sin a - d r + sigma_w w',    y = sin a + sigma_o v

State [a, r]: angle from hanging down in rad and its rate in rad/s; control a torque by moment of inertia in
rad/s^2; measurement the bob's sideways displacement by its length. Near a = pi/2 it is flat. How strongly it
bends is `curvature`: about the anchor z,

    c_kappa(a) = sin z + (sin(z + kappa (a - z)) - sin z) / kappa
               = sin z + (a - z) sinc(kappa (a - z) / 2) cos(z + kappa (a - z) / 2),    sinc t = sin t / t

so that value and slope at z, and what they tell there, are the same for all kappa: kappa = 1 is the sine itself,
kappa = 0 its tangent at z; with z = 0, c_kappa = sin(kappa a) / kappa.
"""

import jax.numpy as jnp
from jax import Array

from ..structs import number, struct


@struct
class Pendulum:
    """A damped pendulum with a torque; its obstacles are stops, angles (n, 1) with a half width."""

    gravity: float = number(ge=0)  # g, over the length, 1/s^2
    damping: float = number(ge=0)  # d, 1/s
    process_noise: float = number(ge=0)  # sigma_w, rad/s^1.5
    sensor_noise: float = number(gt=0)  # sigma_o
    anchor: float = number(default=0.0)  # z, rad
    curvature: float = number(default=1.0, ge=0)  # kappa

    @property
    def H(self) -> Array:
        return jnp.array([[0.0], [1.0]]) * self.process_noise

    def f(self, x: Array) -> Array:
        return jnp.stack([x[1], -self.gravity * jnp.sin(x[0]) - self.damping * x[1]])

    def G(self, x: Array) -> Array:
        return jnp.array([[0.0], [1.0]])

    def c(self, x: Array) -> Array:
        off = x[:1] - self.anchor
        half = self.curvature * off / 2
        return jnp.sin(self.anchor) + off * jnp.sinc(half / jnp.pi) * jnp.cos(self.anchor + half)

    def sigma_o(self, x: Array) -> Array:
        return jnp.reshape(jnp.asarray(self.sensor_noise, dtype=float), (1, 1))
