"""The belief means and controls of one trial, and the gain schedule of the theory along them."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ...belief.prior import prior
from ...belief.schedule import GainSchedule, gain_schedule
from ...errors import ConfigError
from ...problem import Controller, Filter, Problem
from ...simulate import simulate_trial

# Matrix products of a Riccati step: its exponential, the doublings, two solves in each.
RICCATI_PRODUCTS = 100


class TrialPath(NamedTuple):
    """Holds what the continuous theory says along the belief means of a trial."""

    schedule: GainSchedule  # Sigma, K and D along the means
    controls: Array  # (T, nu), of the trial


def simulated_path(
    problem: Problem, filter: Filter, controller: Controller, seed: int
) -> TrialPath:
    """Returns the path of trial 0; raises ConfigError if it is not finite."""
    trial = jax.jit(simulate_trial)(problem, filter, controller, seed, 0)
    means = trial.beliefs.mean
    if not (jnp.all(jnp.isfinite(means)) and jnp.all(jnp.isfinite(trial.controls))):
        raise ConfigError(
            "verify: trial 0 of this system and controller diverges; nothing can be said along it"
        )
    schedule = _schedule_along(problem, trial.controls, means)
    if not all(jnp.all(jnp.isfinite(part)) for part in schedule):
        raise ConfigError(
            "verify: the covariance along trial 0 is not finite; is sigma_o singular?"
        )
    return TrialPath(schedule, trial.controls)


@jax.jit
def _schedule_along(problem: Problem, controls: Array, means: Array) -> GainSchedule:
    start = prior(problem)._replace(mean=means[0])
    return gain_schedule(problem, start, controls, "riccati", means[1:])


def schedule_operations(problem: Problem) -> float:
    """Returns the number of roundings behind a schedule: matrix products at every step."""
    return float(problem.steps * RICCATI_PRODUCTS * len(problem.prior_mean) ** 3)
