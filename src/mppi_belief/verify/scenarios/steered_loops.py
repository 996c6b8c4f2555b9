"""Closed loops of Algorithm 1 as printed on the platform with a steered sensor.

`steered_platform` derives the excess cost c/N that the loops must have.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...controllers import MPPI
from ...filters import EKF
from ...planning.path_costs import RiskSensitive
from ...planning.samplers import InnovationSampler
from ...planning.schedules import SharedCovariance
from ...problem import Problem
from ...simulate import simulate_trial
from ...trial_metrics import metrics
from . import steered_platform
from .steered_platform import PlatformOptimum

STEERED_SAMPLES = (64, 512)  # N
STEERED_TRIALS = 400
UNLIMITED = 1e6  # signal-to-noise ratio of a sensor without limit; it needs up to 3
LIMIT = 0.5  # largest signal-to-noise ratio of the limited sensor
STEERED_BATCH = 50  # trials simulated side by side


class SteeredLoops(NamedTuple):
    """Holds closed loops with one sensor."""

    cost: np.ndarray  # (trials,)
    form: np.ndarray  # (trials,), sum_k 1/2 e_k' S e_k


def platform_algorithm(samples: int) -> MPPI:
    """Returns Algorithm 1 as printed.

    Its schedule is the filter's recursion, which compiles faster and has the same D.
    """
    return MPPI(
        n_samples=samples,
        horizon=steered_platform.PLATFORM_HORIZON,
        temperature=steered_platform.PLATFORM_TEMPERATURE,
        path_cost=RiskSensitive(at_step_end=False),
        sampler=InnovationSampler(),
        schedule=SharedCovariance(method="filter"),
    )


def steered_closed_loops(
    optimum: PlatformOptimum, problem: Problem, samples: int, seed: int, limits: Sequence[float]
) -> list[SteeredLoops]:
    """Returns trials 0..TRIALS-1 for each limit of the sensor; the noise of a trial is the same."""

    def loop(limit: Array, trial: Array) -> tuple[Array, Array]:
        system: Any = problem.system
        limited = replace(problem, system=replace(system, limit=limit))
        done = simulate_trial(limited, EKF(), platform_algorithm(samples), seed, trial)
        e = done.controls + done.beliefs.mean[:-1] @ optimum.K.T
        return metrics(limited, done).cost, 0.5 * jnp.sum(e @ optimum.S * e)

    def trials(limit: Array) -> tuple[Array, Array]:
        return jax.lax.map(
            lambda trial: loop(limit, trial), jnp.arange(STEERED_TRIALS), batch_size=STEERED_BATCH
        )

    run = jax.jit(trials, compiler_options={"xla_backend_optimization_level": 1})
    return [SteeredLoops(*map(np.asarray, run(jnp.asarray(float(limit))))) for limit in limits]
