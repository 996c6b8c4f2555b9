"""Measured paths of one state, x' = f(x) + G u + noise, and filters along the same measurements.

    dx = u dt + sigma_w dw,      dy = (x + kappa x^2 / 2) dt + sigma_o dnu               (1a)(1b)

is the system with a curved measurement; the one with a linear measurement is `ScalarLinear`. All
paths have the same controls.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...belief.prior import sample_prior
from ...costs import GoalObstacleCost
from ...problem import Belief, Filter, Problem, System
from ...simulate import INITIAL_DRAW, PLANT, plant_step, role_key
from ...structs import number, struct
from ..solvers import kushner
from ..solvers.kushner import Moments, Reals

PRIOR_MEAN = 0.5
PRIOR_STD = 0.5
STATE_REACH = 6.0  # half width of the grid: about ten standard deviations of the belief
CONTROL_PIECES = 32  # pieces of constant control in a path


@struct
class CurvedMeasurement:
    """Implements dx = u dt + sigma_w dw, dy = (x + kappa x^2 / 2) dt + sigma_o dnu."""

    curvature: Array | float = number()  # kappa
    process_noise: float = number(ge=0)  # sigma_w
    sensor_noise: float = number(gt=0)  # sigma_o

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


def uncosted_problem(system: System, duration: float, steps: int) -> Problem:
    """Returns the system with the prior of these paths and a cost of the control alone."""
    zero = jnp.zeros(1)
    unit = jnp.ones(1)
    cost = GoalObstacleCost(zero, zero, zero, unit)
    return Problem(
        system,
        cost,
        prior_mean=PRIOR_MEAN * unit,
        prior_std=PRIOR_STD * unit,
        dt=duration / steps,
        steps=steps,
        noise_convention="intensity",
    )


def cosine_controls(steps: int) -> Reals:
    """Returns one period of a cosine in `CONTROL_PIECES` constant pieces (steps,)."""
    phase = 2 * np.pi * np.arange(CONTROL_PIECES) / CONTROL_PIECES
    return np.repeat(np.cos(phase), steps // CONTROL_PIECES)


def simulated_measurements(problem: Problem, seed: int, path: Array) -> Array:
    """Returns the measurements (T, 1) along one path of the plant."""
    key = role_key(seed, path, PLANT)
    controls = jnp.asarray(cosine_controls(problem.steps))

    def step(x: Array, inputs: tuple[Array, Array]) -> tuple[Array, Array]:
        u, k = inputs
        return plant_step(problem, x, u[None], jax.random.fold_in(key, k))

    start = sample_prior(problem, jax.random.fold_in(key, INITIAL_DRAW))
    return jax.lax.scan(step, start, (controls, jnp.arange(problem.steps)))[1]


def filter_moments(
    problem: Problem, filter: Filter, measurements: Array, key: Array
) -> tuple[Array, Array]:
    """Returns means and variances (T+1,) of a filter of one state, given measurements (T, 1)."""

    def step(
        belief: Belief, inputs: tuple[Array, Array, Array]
    ) -> tuple[Belief, tuple[Array, Array]]:
        u, y, k = inputs
        belief = filter.update(problem, belief, u[None], y, jax.random.fold_in(key, k))
        return belief, (belief.mean[0], belief.cov[0, 0])

    first = filter.init(problem, jax.random.fold_in(key, INITIAL_DRAW))
    controls = jnp.asarray(cosine_controls(problem.steps))
    inputs = (controls, measurements, jnp.arange(problem.steps))
    mean, variance = jax.lax.scan(step, first, inputs)[1]
    return jnp.append(first.mean, mean), jnp.append(first.cov[0], variance)


def grid_filter_moments(
    problem: Problem, cells: int, dy: Reals, c: Reals | None = None, substeps: int = 1
) -> Moments:
    """Returns the grid filter's moments for increments dy (T, P).

    `c` (n, P) replaces the system's measurement function if it differs from path to path.
    """
    grid = kushner.state_grid(-STATE_REACH, STATE_REACH, cells)
    model = kushner.coefficients(problem, grid)
    if c is not None:
        model = model._replace(c=c)
    prior = kushner.gaussian_density(grid, PRIOR_MEAN, PRIOR_STD**2)
    controls = cosine_controls(len(dy))
    return kushner.solve_kushner(grid, model, prior, controls, dy, problem.dt, substeps)
