"""K and D of each step on the way from the prior, and the steady states of both schedules."""

import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.linalg import solve_continuous_are, solve_discrete_are

from ...belief.kalman import predict
from ...problem import Belief
from ...results.certificate import Check
from ..bands import rounding
from ..solvers.kushner import Reals
from . import linear_covariance as model
from .linear_covariance import (
    STEP_OPERATIONS,
    WIND_DT,
    ScheduleFunction,
    frobenius_distance,
    largest_relative_error,
    last_piece,
    linear_wind_problem,
    spectral_norm,
    steady_error_flow,
)

SETTLED_PIECES = 50  # after which nothing changes


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
