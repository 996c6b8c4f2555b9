"""Judges a trial: its cost (2), its collisions, and the consistency of its filter."""

import jax
import jax.numpy as jnp
from jax import Array

from .belief.kalman import aim_sensor_ahead
from .filters import EKF
from .numerics.linalg import quadratic_form
from .numerics.square_root import mahalanobis_squared
from .problem import Belief, Filter, GaussianFilter, Problem
from .results.columns import Consistency, Metrics
from .simulate import Trial


def metrics(problem: Problem, trial: Trial) -> Metrics:
    """Returns what a trial is judged by.

    A trial collides where it touches an obstacle at a state or on the straight line between two.
    """
    cost = problem.cost
    rates = jax.vmap(lambda x, u: cost.base(x) + 0.5 * quadratic_form(cost.R, u))(
        trial.states[:-1], trial.controls
    )
    running = jnp.sum(rates) * problem.dt
    terminal = cost.terminal(trial.states[-1])
    clearance = jnp.min(problem.path_clearance(trial.states))
    miss = problem.position_of(trial.states[-1]) - problem.position_of(jnp.asarray(cost.goal))
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
    """Compares a trial's states and measurements with its beliefs, after each measurement.

    Innovations and their covariances are those that the filter itself takes (`GaussianFilter`). For
    other filters they are the extended Kalman filter's, for the mean and covariance of the belief.
    """
    judge = filter if isinstance(filter, GaussianFilter) else EKF()

    def innovation(belief: Belief, u: Array, y: Array) -> tuple[Array, Array]:
        aimed_problem = aim_sensor_ahead(problem, belief, u)
        correction = judge.correct(aimed_problem, judge.predict(aimed_problem, belief, u), y)
        return correction.innovation, correction.innovation_cov

    before = Belief(trial.beliefs.mean[:-1], trial.beliefs.cov[:-1])
    innovations, innovation_covs = jax.vmap(innovation)(before, trial.controls, trial.measurements)
    errors = trial.states[1:] - trial.beliefs.mean[1:]
    return Consistency(
        nees=_mean_squared_distance(errors, trial.beliefs.cov[1:]),
        nis=_mean_squared_distance(innovations, innovation_covs),
    )


def _mean_squared_distance(deviations: Array, covs: Array) -> Array:
    """Returns the mean () of d' cov^-1 d over steps (T, n) and (T, n, n) with a regular covariance.

    The mean is nan where no covariance is regular.
    """
    return jnp.nanmean(jax.vmap(mahalanobis_squared)(deviations, covs))
