"""Metrics of a trial: cost (2), collisions, and the consistency of its filter."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from .belief.kalman import forecast
from .discretise import measurement_difference
from .numerics.linalg import quadratic_form, squared_distance
from .problem import Belief, Filter, Problem
from .simulate import Trial


class Metrics(NamedTuple):
    """What a trial is judged by; each (). Costs are of eq. (2) on the true state, penalties left out,
    the integral as sum_k (base(x_k) + 1/2 u_k' R u_k) dt over k = 0..T-1."""

    cost: Array
    running_cost: Array
    terminal_cost: Array
    collided: Array
    clearance: Array
    final_distance: Array
    ess: Array


class Consistency(NamedTuple):
    """Whether errors are as large as the filter says, means over a trial's T steps; each ().

    nees   (x - mean)' cov^-1 (x - mean), about nx where the belief is that of the state
    nis    d' S^-1 d for the difference d of a measurement from its forecast and its covariance S, about ny

    Steps of which the covariance is singular are left out; nan where that is all of them.
    """

    nees: Array
    nis: Array


def metrics(problem: Problem, trial: Trial) -> Metrics:
    """Judge a trial. A collision is a state, of any step, on or inside an obstacle."""
    system, cost = problem.system, problem.cost
    rates = jax.vmap(lambda x, u: cost.base(x) + 0.5 * quadratic_form(cost.R, u))(
        trial.states[:-1], trial.controls
    )
    running, terminal = jnp.sum(rates) * problem.dt, cost.terminal(trial.states[-1])
    clearance = jnp.min(jax.vmap(system.clearance)(trial.states))
    miss = system.position(trial.states[-1]) - system.position(jnp.asarray(cost.goal))
    return Metrics(
        cost=running + terminal,
        running_cost=running,
        terminal_cost=terminal,
        collided=clearance <= 0,
        clearance=clearance,
        final_distance=jnp.sqrt(jnp.sum(miss**2)),
        ess=jnp.mean(trial.ess),
    )


def consistency(problem: Problem, filter: Filter, trial: Trial) -> Consistency:
    """Hold a trial's states and measurements against its beliefs, after each measurement.

    Measurements are forecast from the belief before by the filter itself, if it has `forecast(problem, belief, u)`, a
    mean (ny,) and a covariance (ny, ny); else from that belief's mean and covariance as linearised.
    """
    told = getattr(filter, "forecast", forecast)
    before = Belief(*(part[:-1] for part in trial.beliefs))
    expected, spread = jax.vmap(lambda belief, u: told(problem, belief, u))(before, trial.controls)
    off = jax.vmap(lambda y, at: measurement_difference(problem.system, y, at))(
        trial.measurements, expected
    )
    errors = trial.states[1:] - trial.beliefs.mean[1:]
    return Consistency(_mean_square(errors, trial.beliefs.cov[1:]), _mean_square(off, spread))


def _mean_square(deviations: Array, covs: Array) -> Array:
    """The mean () of d' cov^-1 d over steps (T, n) and (T, n, n) with a regular covariance, nan without any."""
    found = jax.vmap(squared_distance)(deviations, covs)
    return jnp.nanmean(found)
