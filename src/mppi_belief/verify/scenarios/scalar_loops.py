"""Closed loops on the stationary scalar problem, and the quadratic form of their control errors."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...controllers import MPPI
from ...filters import EKF
from ...planning.path_costs import RiskSensitive
from ...planning.samplers import InnovationSampler
from ...planning.schedules import SharedCovariance
from ...problem import Controller, Problem
from ...simulate import simulate_trial
from ...trial_metrics import metrics
from .stationary_scalar import SCALAR_HORIZON, SCALAR_TEMPERATURE, ScalarOptimum

BATCH = 50  # trials simulated side by side


class ScalarLoops(NamedTuple):
    """Holds closed loops of one controller."""

    cost: np.ndarray  # (trials,)
    mean: np.ndarray  # (trials, steps), mu_k
    control: np.ndarray  # (trials, steps), u_k


def receding_algorithm(samples: int) -> MPPI:
    """Returns Algorithm 1 as printed with the receding horizon of this problem."""
    path_cost = RiskSensitive(at_step_end=False)
    schedule = SharedCovariance(method="riccati")
    return MPPI(
        samples, SCALAR_HORIZON, SCALAR_TEMPERATURE, path_cost, InnovationSampler(), schedule
    )


def closed_loops(problem: Problem, controller: Controller, seed: int, trials: int) -> ScalarLoops:
    """Returns trials 0..trials-1; the noise of a trial is the same for every controller."""

    def loop(trial: Array) -> tuple[Array, Array, Array]:
        done = simulate_trial(problem, EKF(), controller, seed, trial)
        return metrics(problem, done).cost, done.beliefs.mean[:-1, 0], done.controls[:, 0]

    # Compiling takes longer than running. The problem is a constant here, which saves a third of
    # the time, and so does this option.
    options = {"xla_backend_optimization_level": 1}
    loops = jax.jit(
        lambda numbers: jax.lax.map(loop, numbers, batch_size=BATCH), compiler_options=options
    )
    return ScalarLoops(*map(np.asarray, loops(jnp.arange(trials))))


def control_error_form(optimum: ScalarOptimum, loops: ScalarLoops) -> np.ndarray:
    """Returns sum_k 1/2 S e_k^2 (trials,), e_k = u_k + K mu_k."""
    error = loops.control + optimum.gain * loops.mean
    return 0.5 * optimum.hessian * np.sum(error**2, axis=1)
