"""A platform whose sensor makes matching hold, and the predicted excess cost of Algorithm 1.

The terminal weight is the stationary P of the discrete control Riccati equation, so that the
optimum is u = -K mu at every step, whatever the horizon. With u_k = -K mu_k + e_k, completing the
square gives for any control, in expectation,

    J(u) - J* = sum_k 1/2 e_k' S e_k,      S = R dt + B' P B,  B = G dt

D = lambda G R^-1 G' at every step of every plan, so (19) with N -> infinity is u = -K mu exactly:
no excess remains. N samples leave the variance of a ratio of averages. With weights exp(-S /
lambda) squared, which are those of the control weight R / 2 and the temperature lambda / 2, the
increments have the mean -K2 mu and the covariance V2, and

    E e e' = r(mu) (V2 + (K - K2) mu mu' (K - K2)') / N,
    r      = E w^2 / (E w)^2 = exp(mu' Gamma mu + const)

which is averaged over the law of mu, Gaussian with innovations of covariance D dt.
"""

import math
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.linalg import solve_discrete_are

from ...costs import GoalObstacleCost
from ...problem import Problem
from ...systems import Steered

PLATFORM_TEMPERATURE = 1.0  # lambda
PLATFORM_DT = 0.2
PLATFORM_STEPS = 10  # of a trial
PLATFORM_HORIZON = 5  # H of the planner
STIFFNESS = 1.0
DRAG = 0.5
GUSTS = 0.7  # process noise
CONTROL_WEIGHT = 3.0
PLATFORM_NOISE = 0.3  # sigma_o
PLATFORM_WEIGHTS = (2.0, 2.0, 0.5, 0.5)  # running weights of the state
PLATFORM_START = (0.4, -0.2, 0.0, 0.0)  # prior mean
PLATFORM_STD = 0.5  # prior standard deviation


class PlatformOptimum(NamedTuple):
    """Holds the optimum of the discrete problem."""

    F: np.ndarray  # (4, 4), a step of the state
    B: np.ndarray  # (4, 2), effect of a control in a step
    P: np.ndarray  # (4, 4), value
    K: np.ndarray  # (2, 4), gain
    S: np.ndarray  # (2, 2), Hessian of the cost in one control


class PlatformExcess(NamedTuple):
    """Holds the predicted excess cost per_sample / N."""

    per_sample: float  # c
    next_term: float  # the next term is `next_term` / N of c / N


def platform() -> tuple[Problem, PlatformOptimum]:
    """Returns the platform on moorings in the plane, and its optimum, which ignores the sensor."""
    identity = np.eye(2)
    zero = np.zeros((2, 2))
    A = np.block([[zero, identity], [-STIFFNESS * identity, -DRAG * identity]])
    G = np.vstack([zero, identity])
    R = CONTROL_WEIGHT * identity
    q = np.diag(PLATFORM_WEIGHTS)

    # The discrete optimum.
    F = np.eye(4) + PLATFORM_DT * A
    B = PLATFORM_DT * G
    P = solve_discrete_are(F, B, q * PLATFORM_DT, R * PLATFORM_DT)
    S = R * PLATFORM_DT + B.T @ P @ B
    K = np.linalg.solve(S, B.T @ P @ F)

    plant: dict[str, Any] = {
        "A": A,
        "B": G,
        "C": np.eye(2, 4),
        "channel": GUSTS * G,
        "sensor_noise": np.full(2, PLATFORM_NOISE),
    }
    system = Steered(**plant, temperature=PLATFORM_TEMPERATURE, selector="matched")
    cost = GoalObstacleCost(
        goal=jnp.zeros(4),
        running_weight=jnp.array(PLATFORM_WEIGHTS),
        terminal_weight=(P + P.T) / 2,
        control_weight=jnp.asarray(R),
    )
    problem = Problem(
        system,
        cost,
        prior_mean=jnp.array(PLATFORM_START),
        prior_std=jnp.full(4, PLATFORM_STD),
        dt=PLATFORM_DT,
        steps=PLATFORM_STEPS,
        noise_convention="intensity",
    )
    return problem, PlatformOptimum(F, B, P, K, S)


def matched_filter_law(optimum: PlatformOptimum) -> tuple[np.ndarray, np.ndarray]:
    """Returns the covariances (K, 4, 4) of the matched filter before each step, and D dt (4, 4)."""
    F = optimum.F
    B = optimum.B
    innovation = PLATFORM_TEMPERATURE * B @ B.T / (CONTROL_WEIGHT * PLATFORM_DT)
    covs = [PLATFORM_STD**2 * np.eye(4)]
    for _ in range(PLATFORM_STEPS - 1):
        covs.append(F @ covs[-1] @ F.T + GUSTS**2 * B @ B.T / PLATFORM_DT - innovation)
    return np.array(covs), innovation


def platform_optimal_cost(optimum: PlatformOptimum) -> float:
    """Returns the cost of LQG with the matched sensor, by the separation principle."""
    covs, _ = matched_filter_law(optimum)
    start = np.array(PLATFORM_START)
    noise = GUSTS**2 * optimum.B @ optimum.B.T / PLATFORM_DT
    known_state = start @ optimum.P @ start + np.sum(optimum.P * (covs[0] + PLATFORM_STEPS * noise))
    feedback = np.sum(optimum.K.T @ optimum.S @ optimum.K * covs.sum(axis=0))
    return 0.5 * float(known_state + feedback)


def weighted_recursion(
    optimum: PlatformOptimum, R: np.ndarray, tau: float
) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
    """Returns value (4, 4) and constant of E exp(-S / tau) for D = tau G R^-1 G'.

    The gain (2, 4) and the covariance (2, 2) follow of the first control increment under these
    weights.
    """
    F = optimum.F
    B = optimum.B
    P = optimum.P
    constant = 0.0
    for _ in range(PLATFORM_HORIZON):
        S = R * PLATFORM_DT + B.T @ P @ B
        K = np.linalg.solve(S, B.T @ P @ F)
        constant += 0.5 * (np.linalg.slogdet(S)[1] - np.linalg.slogdet(R * PLATFORM_DT)[1])
        P = np.diag(PLATFORM_WEIGHTS) * PLATFORM_DT + F.T @ P @ (F - B @ K)
    return P, constant, K, tau * np.linalg.inv(S)


def platform_excess(optimum: PlatformOptimum) -> PlatformExcess:
    """Returns the excess cost of Algorithm 1, as derived above."""
    R = CONTROL_WEIGHT * np.eye(2)
    P, constant, _, _ = weighted_recursion(optimum, R, PLATFORM_TEMPERATURE)
    P2, constant2, K2, V2 = weighted_recursion(optimum, R / 2, PLATFORM_TEMPERATURE / 2)
    Gamma = (P - P2) / PLATFORM_TEMPERATURE
    gain_change = optimum.K - K2

    # The law of mu along the optimal loop.
    mean = np.array(PLATFORM_START)
    cov = np.zeros((4, 4))
    _, innovation = matched_filter_law(optimum)
    closed_loop = optimum.F - optimum.B @ optimum.K

    total = 0.0
    largest_ratio = 0.0
    for _ in range(PLATFORM_STEPS):
        # The Gaussian integrals of r(mu) and of r(mu) mu mu' over this law.
        narrowing = np.linalg.inv(np.eye(4) - 2 * cov @ Gamma)
        shifted = narrowing @ mean
        exponent = mean @ Gamma @ shifted + 2 * constant - constant2
        ratio = math.exp(exponent) * math.sqrt(np.linalg.det(narrowing))
        second_moment = narrowing @ cov + np.outer(shifted, shifted)
        error_cov = V2 + gain_change @ second_moment @ gain_change.T
        total += 0.5 * ratio * float(np.sum(optimum.S * error_cov))
        largest_ratio = max(largest_ratio, ratio)
        mean = closed_loop @ mean
        cov = closed_loop @ cov @ closed_loop.T + innovation
    return PlatformExcess(total, largest_ratio)
