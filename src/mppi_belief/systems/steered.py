"""A linear system whose sensor can be turned, so that matching (15) holds in any dimension (arXiv 2604.18941).

    dx = (A x + B u) dt + H dw,      dy = C(Sigma) x dt + sigma_o dnu,      C(Sigma) of `mppi_belief.matching.sensor`

With `selector: matched` C follows the covariance of the belief; with `fixed` it is the matrix given.
"""

from dataclasses import replace

import jax.numpy as jnp
from jax import Array

from ..discretise import measurement_factor
from ..matching.sensor import matching_sensor
from ..numerics.linalg import as_matrix
from ..structs import array, choice, number, size, struct


@struct
class Steered:
    """nx states, nu controls, ny >= nu measurements, nw noise channels, no obstacles.

    temperature, control_weight   lambda and R of (15): those of the planner and of the cost
    limit      the largest signal-to-noise ratio, singular value of sigma_o^-1 C; None: any
    places     how many of the leading states are a position, in which distances are measured
    """

    A: Array = array(ndim=2)  # (nx, nx)
    B: Array = array(ndim=2)  # (nx, nu)
    C: Array = array(ndim=2)  # (ny, nx), of the fixed sensor
    channel: Array = array(ndim=2)  # H (nx, nw)
    sensor_noise: Array = array(ndim=1, gt=0)  # the diagonal of sigma_o (ny,)
    control_weight: Array = array(ndim=(1, 2), gt=0)  # R (nu,) or (nu, nu)
    temperature: float = number(1.0, gt=0)
    limit: float | None = number(None, gt=0, optional=True)
    places: int = size(2)
    selector: str = choice("matched", "fixed")
    noise_convention: str = choice("intensity", "sample")

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

    def position(self, x: Array) -> Array:
        return x[: self.places]

    def clearance(self, x: Array) -> Array:
        return jnp.asarray(jnp.inf)

    def aimed(self, mean: Array, root: Array, dt: Array | float, sampled: bool) -> "Steered":
        """The system with the sensor that a belief N(mean (nx,), root root' (nx, nx)) asks for, which then stays.

        `sampled` measurements come every dt, and the belief is that before one; otherwise the measurement is
        continuous.
        """
        if self.selector == "fixed":
            return self
        noise = measurement_factor(self, mean, dt) * jnp.sqrt(dt)
        wanted = matching_sensor(
            root,
            self.G(mean),
            as_matrix(self.control_weight),
            self.temperature,
            noise,
            dt if sampled else 0.0,
            self.limit,
        )
        return replace(self, C=wanted, selector="fixed")
