"""A linear system whose covariance is known in advance, and bounds of its errors (Prop. 2).

    dSigma/dt = A Sigma + Sigma A' + Q - Sigma C' R_o^-1 C Sigma                          (8b)(11)
    K = Sigma C' R_o^-1,    D = K R_o K'                                                  (8a)(9)

No relative error grows: for an error E with -e Sigma <= E <= e Sigma the flow of (8b), concave,
increasing and not negative at zero, keeps e from growing, and so does its discrete form. Errors of
relative size e at each step thus add up to at most (steps) (condition of Sigma) e.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from ...belief.prior import prior
from ...belief.riccati import kalman_bucy_gain, riccati_rate
from ...belief.schedule import GainSchedule
from ...costs import GoalObstacleCost
from ...problem import Belief, Problem
from ...systems import Linear
from ..solvers.kushner import Reals
from .section_vii import light_dark_problem

ScheduleFunction = Callable[..., GainSchedule]

# The states are position, velocity and a fluctuating wind; measured are the position and, roughly,
# the airspeed.
WIND_A = np.array([[0.0, 1.0, 0.0], [0.0, -0.2, 1.0], [0.0, 0.0, -0.5]])
WIND_B = np.array([[0.0], [1.0], [0.0]])
WIND_C = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -0.3]])
WIND_H = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.4]])
SENSOR_NOISE = np.array([0.3, 0.5])
WIND_Q = WIND_H @ WIND_H.T
WIND_R_O = np.diag(SENSOR_NOISE**2)

WIND_DURATION = 1.0  # T
PIECE_STEPS = 20  # of a piece; schedules are computed in pieces, which compile once
LOCAL_ERROR = 1e-12  # of the reference's integrator in a step
WIND_DT = 0.1  # of the closed loops and of the settled filter
# Roundings of an entry of Sigma in a step: some 20 matrix products of n terms.
STEP_OPERATIONS = 200


class CovarianceReference(NamedTuple):
    """Holds the solution of (8b) at T by an integrator."""

    cov: Reals  # (3, 3), Sigma
    gain: Reals  # (3, 2), K
    diffusion: Reals  # (3, 3), D
    error: float  # bound on the error of Sigma
    condition: float  # largest condition number of Sigma on the way


def linear_wind_problem(dt: float) -> Problem:
    """Returns `PIECE_STEPS` steps of the linear system with a quadratic cost."""
    A, B, C, H, noise = map(jnp.asarray, (WIND_A, WIND_B, WIND_C, WIND_H, SENSOR_NOISE))
    system = Linear(A, B, C, H, noise)
    unit = jnp.ones(3)
    cost = GoalObstacleCost(0 * unit, unit, unit, jnp.ones(1))
    std = jnp.array([0.5, 0.4, 0.3])
    return Problem(system, cost, jnp.zeros(3), std, dt, PIECE_STEPS, noise_convention="intensity")


def state_dependent_problem(dt: float) -> Problem:
    """Returns the light-dark system of Sec. VII, whose noise depends on where the vehicle is."""
    mean = jnp.array([1.0, 1.0, 0.0, 0.0])
    std = jnp.array([0.2, 0.2, 0.05, 0.05])
    return light_dark_problem("intensity", mean, std, dt, PIECE_STEPS)


def last_piece(
    schedule: ScheduleFunction, problem: Problem, pieces: int, method: str
) -> GainSchedule:
    """Returns the last of `pieces` consecutive schedules without controls."""
    belief = prior(problem)
    for _ in range(pieces):
        piece = schedule(problem, belief, jnp.zeros((PIECE_STEPS, 1)), method)
        belief = Belief(piece.mean[-1], piece.cov[-1])
    return piece


def integrated_reference() -> CovarianceReference:
    """Returns (8b) by DOP853, whose local errors add up as the module derives."""
    start = np.asarray(prior(linear_wind_problem(WIND_DT)).cov)
    rate = jax.jit(
        lambda cov: riccati_rate(cov, *map(jnp.asarray, (WIND_A, WIND_Q, WIND_C, WIND_R_O)))
    )

    def flat_rate(_: float, cov: Reals) -> Reals:
        return np.asarray(rate(cov.reshape(start.shape))).ravel()

    solution = solve_ivp(
        flat_rate,
        (0, WIND_DURATION),
        start.ravel(),
        method="DOP853",
        rtol=LOCAL_ERROR,
        atol=LOCAL_ERROR * start.max(),
    )
    covs = solution.y.T.reshape(-1, *start.shape)
    K, D = kalman_bucy_gain(jnp.asarray(covs[-1]), jnp.asarray(WIND_C), jnp.asarray(WIND_R_O))
    condition = float(np.max(np.linalg.cond(covs)))
    error = len(covs) * condition * 2 * LOCAL_ERROR * len(start) * spectral_norm(covs[-1])
    return CovarianceReference(covs[-1], np.asarray(K), np.asarray(D), error, condition)


def kalman_recursion(cov: Reals, steps: int) -> Reals:
    """Returns the Kalman filter's covariances (steps + 1, 3, 3) of the linear system, by NumPy."""
    F = np.eye(len(cov)) + WIND_A * WIND_DT
    covs = [cov]
    for _ in range(steps):
        predicted = F @ covs[-1] @ F.T + WIND_Q * WIND_DT
        S = WIND_C @ predicted @ WIND_C.T + WIND_R_O / WIND_DT
        covs.append(predicted - predicted @ WIND_C.T @ np.linalg.solve(S, WIND_C @ predicted))
    return np.array(covs)


def steady_error_flow(cov: Reals) -> Reals:
    """Returns what a step WIND_DT of the steady filter does to an error of its mean (3, 3)."""
    return np.asarray(expm((WIND_A - cov @ WIND_C.T @ np.linalg.inv(WIND_R_O) @ WIND_C) * WIND_DT))


def spectral_norm(M: Reals) -> float:
    """Returns the largest singular value."""
    return float(np.linalg.norm(M, 2))


def frobenius_distance(matrix: Array | Reals, reference: Reals) -> float:
    """Returns the Frobenius norm of the difference."""
    return float(np.linalg.norm(np.asarray(matrix) - reference))


def largest_relative_error(matrices: Reals, references: Reals, sizes: Reals) -> float:
    """Returns the largest difference of (T, m, n) over the norms of `sizes` (T, ., .)."""
    differences, norms = (
        np.linalg.norm(part, axis=(1, 2)) for part in (matrices - references, sizes)
    )
    return float(np.max(differences / norms))


def accumulated_roundings(covs: Reals) -> float:
    """Returns the roundings of Sigma, relative to its norm, after the steps of covs (T+1, n, n)."""
    return float(np.ceil((len(covs) - 1) * np.max(np.linalg.cond(covs)) * STEP_OPERATIONS))


def differing_entries(copies: Reals) -> int:
    """Returns how many entries of (N, ...) are not the same bits in all N copies."""
    return int(np.sum(np.any(copies != copies[:1], axis=0)))
