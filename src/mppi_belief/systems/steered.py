"""A linear system whose sensor can be turned, so that matching (15) holds in any dimension.

    dx = (A x + B u) dt + H dw,      dy = C(Sigma) x dt + sigma_o dnu

with C(Sigma) of `mppi_belief.matching.sensor`, after arXiv 2604.18941. With `selector: matched` C
follows the covariance of the belief; with `fixed` it is the matrix given.
"""

from dataclasses import replace

import jax.numpy as jnp
from jax import Array

from ..discretise import measurement_factor
from ..matching.sensor import matching_sensor
from ..problem import Problem
from ..structs import ArrayField, array, choice, number, struct


@struct
class Steered:
    """Represents a linear system with a sensor that can be turned.

    It has nx states, nu controls, ny >= nu measurements and nw noise channels.
    """

    A: ArrayField = array(ndim=2)  # (nx, nx)
    B: ArrayField = array(ndim=2)  # (nx, nu)
    C: ArrayField = array(ndim=2)  # (ny, nx), of the fixed sensor
    channel: ArrayField = array(ndim=2)  # H (nx, nw)
    sensor_noise: ArrayField = array(ndim=1, gt=0)  # the diagonal of sigma_o (ny,)
    temperature: float = number(default=1.0, gt=0)  # lambda of (15), that of the planner
    # The largest singular value of sigma_o^-1 C; None: any.
    limit: float | None = number(default=None, gt=0, optional=True)
    # Whether C follows the covariance or is the matrix given.
    selector: str = choice("matched", "fixed", default="matched")

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

    def aimed(self, problem: Problem, mean: Array, root: Array, sampled: bool) -> "Steered":
        """Returns the system with the sensor that a belief asks for, fixed from then on.

        The belief is N(mean, root root'), mean (nx,) and root (nx, nx). With `sampled` it is the
        belief before a measurement every dt, and otherwise that of a continuous measurement.
        """
        if self.selector == "fixed":
            return self
        dt = problem.dt
        C = matching_sensor(
            root,
            self.G(mean),
            problem.cost.R,
            self.temperature,
            measurement_factor(problem, mean) * jnp.sqrt(dt),
            dt if sampled else 0.0,
            self.limit,
        )
        return replace(self, C=C, selector="fixed")
