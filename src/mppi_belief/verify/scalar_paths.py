"""Paths of one state that is measured, x' = f(x) + G u + noise, and the filters that see the same measurements.

    dx = u dt + sigma_w dw,      dy = (x + kappa x^2 / 2) dt + sigma_o dnu               (1a)(1b)

is the measurement that is curved; the linear one is `ScalarLinear`. All paths have the same controls.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..belief.prior import sample_prior
from ..costs import GoalObstacleCost
from ..problem import Belief, Filter, Problem, System
from ..simulate import INITIAL_DRAW, PLANT, plant_step, role_key
from ..structs import number, struct
from . import kushner
from .kushner import Moments, Reals

PRIOR_MEAN, PRIOR_STD = 0.5, 0.5
REACH = 6.0  # the grid's half width: some ten standard deviations of the belief from where it goes
HELD = 32  # controls of a path, each held for as many steps as it takes


@struct
class Curved:
    """dx = u dt + sigma_w dw,  dy = (x + kappa x^2 / 2) dt + sigma_o dnu."""

    curvature: Array | float = number()  # kappa
    process_noise: float = number(ge=0)
    sensor_noise: float = number(gt=0)

    @property
    def H(self) -> Array:
        return jnp.reshape(jnp.asarray(self.process_noise, dtype=float), (1, 1))

    def f(self, x: Array) -> Array:
        return jnp.zeros_like(x)

    def G(self, x: Array) -> Array:
        return jnp.ones((1, 1))

    def c(self, x: Array) -> Array:
        return x + self.curvature * x**2 / 2

    def sigma_o(self, x: Array) -> Array:
        return jnp.reshape(jnp.asarray(self.sensor_noise, dtype=float), (1, 1))


def problem_of(system: System, duration: float, steps: int) -> Problem:
    """The system with the prior of this certificate; nothing is paid for."""
    nothing, one = jnp.zeros(1), jnp.ones(1)
    free = GoalObstacleCost(nothing, nothing, nothing, one)
    return Problem(
        system,
        free,
        PRIOR_MEAN * one,
        PRIOR_STD * one,
        duration / steps,
        steps,
        noise_convention="intensity",
    )


def controls_of(steps: int) -> Reals:
    """One period of a cosine in `HELD` pieces (steps,)."""
    return np.repeat(np.cos(2 * np.pi * np.arange(HELD) / HELD), steps // HELD)


def measured(problem: Problem, seed: int, path: Array) -> Array:
    """Measurements (T, 1) of one path of the plant."""
    key, controls = role_key(seed, path, PLANT), jnp.asarray(controls_of(problem.steps))

    def step(x: Array, given: tuple[Array, Array]) -> tuple[Array, Array]:
        u, k = given
        return plant_step(problem, x, u[None], jax.random.fold_in(key, k))

    start = sample_prior(problem, jax.random.fold_in(key, INITIAL_DRAW))
    return jax.lax.scan(step, start, (controls, jnp.arange(problem.steps)))[1]


def filtered(
    problem: Problem, filter: Filter, measurements: Array, key: Array
) -> tuple[Array, Array]:
    """Means and variances (T+1,) of a filter of one state given measurements (T, 1)."""

    def step(
        belief: Belief, given: tuple[Array, Array, Array]
    ) -> tuple[Belief, tuple[Array, Array]]:
        u, y, k = given
        belief = filter.update(problem, belief, u[None], y, jax.random.fold_in(key, k))
        return belief, (belief.mean[0], belief.cov[0, 0])

    first = filter.init(problem, jax.random.fold_in(key, INITIAL_DRAW))
    given = (jnp.asarray(controls_of(problem.steps)), measurements, jnp.arange(problem.steps))
    mean, variance = jax.lax.scan(step, first, given)[1]
    return jnp.append(first.mean, mean), jnp.append(first.cov[0], variance)


def on_grid(
    problem: Problem, cells: int, dy: Reals, c: Reals | None = None, substeps: int = 1
) -> Moments:
    """The grid filter's moments for increments dy (T, P); `c` (n, P) if it differs from path to path."""
    on = kushner.grid(-REACH, REACH, cells)
    model = kushner.coefficients(problem, on)
    model = model if c is None else model._replace(c=c)
    start = kushner.gaussian(on, PRIOR_MEAN, PRIOR_STD**2)
    return kushner.solve(on, model, start, controls_of(len(dy)), dy, problem.dt, substeps)
