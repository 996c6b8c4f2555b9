"""A pendulum seen from the side: its angle is measured through a sine.

    a' = r,   r' = u - g sin a - d r + sigma_w w'
    y  = sin a + sigma_o v

State [a, r]: angle from hanging down in rad and its rate in rad/s; control a torque over the moment
of inertia in rad/s^2; measurement the bob's sideways displacement over its length, which hardly
depends on the angle near a = pi/2. `curvature` kappa says how nonlinear it is about the anchor z:

    c_kappa(a) = sin z + (sin(z + kappa (a - z)) - sin z) / kappa
               = sin z + (a - z) sinc(kappa (a - z) / 2) cos(z + kappa (a - z) / 2)

with sinc t = sin t / t. Value and derivative at z are the same for all kappa, and so is the
information that they give there. kappa = 1 is the sine itself, kappa = 0 its tangent at z; with
z = 0, c_kappa = sin(kappa a) / kappa.
"""

import jax.numpy as jnp
from jax import Array

from ..structs import number, struct


@struct
class Pendulum:
    """Represents a damped pendulum with a torque.

    Its position is the angle; obstacles of a problem are stops, angles (n, 1) with a half width.
    """

    gravity: float = number(ge=0)  # g, over the length, 1/s^2
    damping: float = number(ge=0)  # d, 1/s
    process_noise: float = number(ge=0)  # sigma_w, rad/s^1.5
    sensor_noise: float = number(gt=0)  # sigma_o
    anchor: float = number(default=0.0)  # z, rad
    curvature: float = number(default=1.0, ge=0)  # kappa

    state_labels = ("angle (rad)", "rate (rad/s)")

    @property
    def H(self) -> Array:
        return jnp.array([[0.0], [1.0]]) * self.process_noise

    def f(self, x: Array) -> Array:
        return jnp.stack([x[1], -self.gravity * jnp.sin(x[0]) - self.damping * x[1]])

    def G(self, x: Array) -> Array:
        return jnp.array([[0.0], [1.0]])

    def c(self, x: Array) -> Array:
        z = self.anchor
        offset = x[:1] - z
        half = self.curvature * offset / 2
        return jnp.sin(z) + offset * jnp.sinc(half / jnp.pi) * jnp.cos(z + half)

    def sigma_o(self, x: Array) -> Array:
        return jnp.reshape(jnp.asarray(self.sensor_noise, dtype=float), (1, 1))
