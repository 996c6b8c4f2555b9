"""Where f and c are linear and G is constant, the covariance is known in advance (Proposition 2).

    dSigma/dt = A Sigma + Sigma A' + Q - Sigma C' R_o^-1 C Sigma                          (8b)(11)
    K = Sigma C' R_o^-1,    D = K R_o K'                                                  (8a)(9)

The package's discrete recursion tends to this at first order in dt, does not depend on controls or
measurements, and settles at the solutions of the algebraic Riccati equations.
`scenarios.linear_covariance` derives how rounding accumulates.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...belief.prior import prior
from ...belief.schedule import GainSchedule, gain_schedule
from ...controllers import LQG
from ...filters import EKF
from ...problem import Problem
from ...results.certificate import Certificate, Check
from ...simulate import simulate_trial
from ..bands import EPSILON, at_least, at_most, rounding
from ..scenarios.covariance_limits import short_step_results
from ..scenarios.covariance_steps import per_step_checks, settled_checks
from ..scenarios.linear_covariance import (
    PIECE_STEPS,
    WIND_DT,
    accumulated_roundings,
    differing_entries,
    kalman_recursion,
    linear_wind_problem,
    spectral_norm,
    state_dependent_problem,
)

REPEATS = 20  # control sequences, and trials
COVARIANCE_TEXT = (
    "For a linear system with three states, the package's filter recursion is refined in time, run "
    "under random controls and in closed loops, and continued until it settles. Covariance, gain "
    "and diffusion tend to those of Proposition 2 at first order, and not one bit of them depends "
    "on controls or measurements. This holds for linear f and c, constant G and constant noise: in "
    "the light-dark system the covariance depends on the controls, through the vehicle's position."
)


def certify(seed: int = 0) -> Certificate:
    """Returns the certificate; `seed` draws controls and measurements."""
    schedule = jax.jit(gain_schedule, static_argnames="method")
    limit_checks, panel = short_step_results(schedule)
    checks = [
        *limit_checks,
        *per_step_checks(schedule),
        *independence_checks(linear_wind_problem(WIND_DT), seed),
        *settled_checks(schedule),
        dependence_check(seed),
    ]
    return Certificate(
        "deterministic_covariance",
        "Proposition 2, deterministic covariance",
        COVARIANCE_TEXT,
        checks,
        [panel],
    )


def schedules_under(problem: Problem, controls: Array) -> GainSchedule:
    """Returns the filter's schedules for controls (N, PIECE_STEPS, nu), compiled as one program."""
    start = prior(problem)
    each = jax.jit(lambda all_u: jax.lax.map(lambda u: gain_schedule(problem, start, u), all_u))
    return each(controls)


def independence_checks(problem: Problem, seed: int) -> list[Check]:
    """Returns checks that neither controls nor measurements matter for the linear system."""
    rng = np.random.default_rng(seed)
    planned = schedules_under(problem, jnp.asarray(rng.normal(size=(REPEATS, PIECE_STEPS, 1)) * 5))
    run = partial(simulate_trial, problem, EKF(), LQG(0, at_step_end=False), seed)
    trials = jax.jit(lambda numbers: jax.lax.map(run, numbers))(jnp.arange(REPEATS))
    covs = np.asarray(trials.beliefs.cov)
    differing = sum(
        differing_entries(np.asarray(part))
        for part in (planned.cov, planned.gain, planned.diffusion, covs)
    )
    by_numpy = kalman_recursion(covs[0, 0], PIECE_STEPS)
    return [
        at_most(
            f"entries that differ in a bit: Σ, K, D over {REPEATS} control sequences, "
            f"Σ over {REPEATS} closed loops",
            differing,
            0,
            "nothing that is random enters: the same operations",
        ),
        rounding(
            "EKF's Σ in closed loop against NumPy's recursion",
            np.max(np.linalg.norm(covs - by_numpy, axis=(-2, -1))),
            2 * accumulated_roundings(by_numpy),
            max(map(spectral_norm, by_numpy)),
        ),
    ]


def dependence_check(seed: int) -> Check:
    """Returns the check that controls move the covariance where the noise depends on the state.

    The spread must exceed what rounding can explain.
    """
    rng = np.random.default_rng(seed)
    controls = np.repeat(rng.normal(size=(REPEATS, 1, 2)) * 3, PIECE_STEPS, axis=1)
    schedules = schedules_under(state_dependent_problem(WIND_DT), jnp.asarray(controls))
    covs = np.asarray(schedules.cov)
    traces = np.trace(covs[:, -1], axis1=-2, axis2=-1)
    roundings = [
        2 * accumulated_roundings(each) * each.shape[-1] * max(map(spectral_norm, each))
        for each in covs
    ]
    return at_least(
        "light-dark: spread of tr Σ at T over random controls",
        np.ptp(traces),
        max(roundings) * EPSILON,
        "what rounding could make of equal traces",
    )
