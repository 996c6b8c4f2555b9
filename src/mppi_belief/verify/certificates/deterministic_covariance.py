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
from scipy.linalg import solve_continuous_are, solve_discrete_are

from ...belief.kalman import predict
from ...belief.prior import prior
from ...belief.schedule import GainSchedule, gain_schedule
from ...controllers import LQG
from ...filters import EKF
from ...problem import Belief, Problem
from ...results.certificate import Certificate, Check, Line, Panel
from ...simulate import simulate_trial
from ..bands import EPSILON, at_least, at_most, order, rounding
from ..scenarios import linear_covariance as model
from ..scenarios.linear_covariance import (
    PIECE_STEPS,
    STEP_OPERATIONS,
    WIND_DT,
    WIND_DURATION,
    ScheduleFunction,
    accumulated_roundings,
    differing_entries,
    frobenius_distance,
    integrated_reference,
    kalman_recursion,
    largest_relative_error,
    last_piece,
    linear_wind_problem,
    spectral_norm,
    state_dependent_problem,
    steady_error_flow,
)
from ..solvers.kushner import Reals

PIECES = (1, 2, 4, 8, 16)  # of PIECE_STEPS steps over T: ever shorter steps
REPEATS = 20  # control sequences, and trials
SETTLED_PIECES = 50  # after which nothing changes
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


def short_step_results(schedule: ScheduleFunction) -> tuple[list[Check], Panel]:
    """Returns checks and figure of Sigma, K / dt and D at T as dt goes to zero."""
    reference = integrated_reference()
    exact = {"Σ": reference.cov, "K/Δt": reference.gain, "D": reference.diffusion}
    lengths = [WIND_DURATION / (pieces * PIECE_STEPS) for pieces in PIECES]

    # The discrete filter and the exact Riccati step, for ever shorter steps.
    values: dict[str, list[Reals]] = {name: [] for name in exact}
    riccati_errors = []
    for pieces, dt in zip(PIECES, lengths, strict=True):
        problem = linear_wind_problem(dt)
        last = last_piece(schedule, problem, pieces, "filter")
        values["Σ"].append(np.asarray(last.cov[-1]))
        values["K/Δt"].append(np.asarray(last.gain[-1] / dt))
        values["D"].append(np.asarray(last.diffusion[-1]))
        flow = last_piece(schedule, problem, pieces, "riccati").cov[-1]
        riccati_errors.append(frobenius_distance(flow, reference.cov))
    errors = {
        name: [frobenius_distance(value, exact[name]) for value in values[name]] for name in exact
    }

    steps = PIECES[-1] * PIECE_STEPS
    roundings = steps * reference.condition * STEP_OPERATIONS * EPSILON
    rounded = roundings * spectral_norm(reference.cov)
    checks = [
        order("order in Δt of the discrete filter's Σ at T against (8b)", 1, errors["Σ"]),
        _extrapolation_check(values, exact),
        at_most(
            "Σ at T by the exact Riccati step, 20 to 320 steps, against an integrator",
            max(riccati_errors),
            reference.error + rounded,
            "(local error)(steps)(condition of Σ); no relative error of Σ grows",
        ),
    ]
    lines = [Line(name, lengths, distances) for name, distances in errors.items()]
    first_order = [1.6 * errors["Σ"][0] * dt / lengths[0] for dt in lengths]
    lines.append(Line("order 1", lengths, first_order, "dashed"))
    panel = Panel(
        "The discrete filter tends to (8b)(9)", "Δt (s)", "error at T (Frobenius)", lines, "xy"
    )
    return checks, panel


def _extrapolation_check(values: dict[str, list[Reals]], exact: dict[str, Reals]) -> Check:
    """Checks the limits: one that is wrong by less than the last error hardly changes an order."""
    ratios = []
    for name, levels in values.items():
        before, last = (2 * levels[j] - levels[j - 1] for j in (-2, -1))
        ratios.append(frobenius_distance(last, exact[name]) / frobenius_distance(last, before))
    return at_most(
        "extrapolated limits of Σ, K/Δt, D: distance from (8b)(9) over their last change",
        max(ratios),
        2 / 3,
        "of second order: a third of the last change is missing; twice that",
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


def per_step_checks(schedule: ScheduleFunction) -> list[Check]:
    """Returns checks that K and D of both schedules belong to the Sigma of their step.

    The belief is on the way from the prior. (9) of the discrete filter is what a measurement
    subtracts from the covariance; (8a)(9) of the Riccati schedule are those at t_k.
    """
    A = model.WIND_A
    C = model.WIND_C
    Q = model.WIND_Q
    R_O = model.WIND_R_O
    filtered, flowed = (
        last_piece(schedule, linear_wind_problem(WIND_DT), 1, method)
        for method in ("filter", "riccati")
    )

    # The discrete filter.
    F = np.eye(len(A)) + A * WIND_DT
    before = np.asarray(filtered.cov)[:-1]
    after = np.asarray(filtered.cov)[1:]
    predicted = F @ before @ F.T + Q * WIND_DT
    S = C @ predicted @ C.T + R_O / WIND_DT
    diffusion = np.asarray(filtered.diffusion) * WIND_DT
    diffusion_error = largest_relative_error(diffusion, predicted - after, predicted)
    gain_error = largest_relative_error(np.asarray(filtered.gain) @ S, predicted @ C.T, predicted)

    # The Riccati schedule.
    Sigma = np.asarray(flowed.cov)[:-1]
    K = Sigma @ C.T @ np.linalg.inv(R_O)
    D = K @ C @ Sigma
    riccati_error = max(
        largest_relative_error(np.asarray(flowed.gain), K, K),
        largest_relative_error(np.asarray(flowed.diffusion), D, D),
    )
    return [
        rounding(
            "filter's schedule: K S = Σ⁻C', D Δt = what a measurement takes off Σ⁻; relative",
            max(diffusion_error, gain_error),
            np.ceil(STEP_OPERATIONS * np.max(np.linalg.cond(S))),
        ),
        rounding(
            "Riccati schedule: K, D against ΣC'R_o⁻¹, ΣC'R_o⁻¹CΣ at the same t_k, relative",
            riccati_error,
            np.ceil(STEP_OPERATIONS * np.linalg.cond(R_O)),
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


def settled_checks(schedule: ScheduleFunction) -> list[Check]:
    """Returns checks of the steady states against SciPy's algebraic Riccati equations.

    A step changes an error E into Phi E Phi' and adds its rounding, so that the error that persists
    is the rounding over the least singular value of 1 - Phi x Phi.
    """
    A = model.WIND_A
    C = model.WIND_C
    Q = model.WIND_Q
    R_O = model.WIND_R_O
    problem = linear_wind_problem(WIND_DT)
    continuous = solve_continuous_are(A.T, C.T, Q, R_O)
    flowed = last_piece(schedule, problem, SETTLED_PIECES, "riccati").cov[-1]

    # The discrete filter, before a measurement.
    F = np.eye(3) + A * WIND_DT
    discrete = solve_discrete_are(F.T, C.T, Q * WIND_DT, R_O / WIND_DT)
    filtered = last_piece(schedule, problem, SETTLED_PIECES, "filter")
    belief = Belief(filtered.mean[-1], filtered.cov[-1])
    predicted = predict(problem, belief, jnp.zeros(1)).cov
    K = discrete @ C.T @ np.linalg.inv(C @ discrete @ C.T + R_O / WIND_DT)
    return [
        _steady_check(
            "Riccati step, settled, against the continuous algebraic equation",
            flowed,
            continuous,
            steady_error_flow(continuous),
        ),
        _steady_check(
            "discrete filter, settled and predicted, against the discrete one",
            predicted,
            discrete,
            F @ (np.eye(3) - K @ C),
        ),
    ]


def _steady_check(computed: str, cov: Array, exact: Reals, Phi: Reals) -> Check:
    separation = np.linalg.svd(np.eye(9) - np.kron(Phi, Phi), compute_uv=False)[-1]
    operations = np.ceil(2 * STEP_OPERATIONS / separation)
    return rounding(computed, frobenius_distance(cov, exact), operations, spectral_norm(exact))
