"""Theorem 6 for a double integrator whose D = lambda G R^-1 G' has rank one.

    u_0 = sum_i w_i R^-1 G' (G R^-1 G')^+ L_0 eps_0^(i) / dt                         (19)

With a quadratic cost, the weight exp(-S / lambda) turns the Gaussian law of eps into another
Gaussian, so that the expectation of (19) is a matter of dense linear algebra. All quantities are
dimensionless.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

from ...costs import GoalObstacleCost
from ...planning import path_integral as pi
from ...problem import Problem
from ...results.certificate import Check
from ...systems import Linear
from ..bands import order, rounding
from ..estimates import largest_magnitude
from .matched_scalar import SteadySchedule, matching_check, steady_schedule

INTEGRATOR_DURATION = 1.0
INTEGRATOR_STEPS = (10, 20, 40, 80)  # of the exact expectation
INTEGRATOR_STATES = np.array([[0.0, 0.0], [-0.5, 0.5], [1.5, -0.5], [0.5, 1.0]])


def double_integrator(steps: int = INTEGRATOR_STEPS[0]) -> tuple[Problem, np.ndarray, float]:
    """Returns problem, Sigma (2, 2) and lambda; the state is [p, v], the control an acceleration.

    Sigma is the steady state of (8b) by construction: C = s G' Sigma^-1 with R_o = 1 makes
    K = s G, and Q = D - A Sigma - Sigma A'.
    """
    A = np.array([[0.0, 1.0], [0.0, 0.0]])
    G = np.array([[0.0], [1.0]])
    cov = np.array([[0.5, -0.15], [-0.15, 0.3]])
    diffusion = 0.4  # s^2, the one entry of D
    temperature = 0.5

    C = np.sqrt(diffusion) * np.linalg.solve(cov, G).T
    H = np.linalg.cholesky(diffusion * G @ G.T - A @ cov - cov @ A.T)
    system = Linear(jnp.asarray(A), jnp.asarray(G), jnp.asarray(C), jnp.asarray(H), jnp.ones(1))
    cost = GoalObstacleCost(
        goal=jnp.array([0.5, 0.0]),  # at rest, so that the distance from it obeys the dynamics
        running_weight=jnp.array([1.0, 0.3]),
        terminal_weight=jnp.array([2.0, 0.5]),
        control_weight=jnp.array([temperature / diffusion]),
    )
    problem = Problem(
        system,
        cost,
        prior_mean=jnp.zeros(2),
        prior_std=jnp.sqrt(jnp.diag(jnp.asarray(cov))),
        dt=INTEGRATOR_DURATION / steps,
        steps=steps,
        noise_convention="intensity",
    )
    return problem, cov, temperature


def deficient_rank_checks() -> list[Check]:
    """Returns the checks that (19) is finite and right where D has no inverse."""
    problem, cov, temperature = double_integrator()
    schedule = steady_schedule(problem, cov)
    distances = []
    for steps in INTEGRATOR_STEPS:
        gaps = [
            expected_control(problem, schedule, temperature, state, steps)
            - lqr_control(problem, state)
            for state in INTEGRATOR_STATES
        ]
        distances.append(float(np.linalg.norm(gaps)))
    return [
        *algebra_checks(problem, schedule, temperature),
        order(
            "D of rank 1: exact expectation of (19) against the Riccati equation, order in Δt",
            1,
            distances,
        ),
    ]


def algebra_checks(problem: Problem, schedule: SteadySchedule, temperature: float) -> list[Check]:
    """Checks (15), and the pseudoinverse on disturbances in and outside the range of D."""
    G = problem.system.G(jnp.zeros(2))
    R = problem.cost.R
    D = jnp.asarray(schedule.diffusion[0])
    control_map = np.asarray(pi.control_map(G, R))
    D_inverse = jnp.linalg.pinv(D, hermitian=True)
    printed_map = np.asarray(temperature * jnp.linalg.solve(R, G.T) @ D_inverse)
    outside_range = np.eye(2) - np.asarray(G @ jnp.linalg.pinv(G))
    error = max(
        largest_magnitude(control_map - printed_map),
        largest_magnitude(control_map @ outside_range),
    )
    return [
        matching_check(
            "D of rank 1: largest residual ε of (15) along the gain schedule",
            problem,
            temperature,
            schedule,
        ),
        rounding(
            "control map of (19) less λR⁻¹G'D⁺, and what it makes of the rest of the space",
            error,
            1000,
        ),
    ]


def expected_control(
    problem: Problem, schedule: SteadySchedule, temperature: float, start: np.ndarray, steps: int
) -> float:
    """Returns the expectation of (19) from a state (2,)."""
    L = np.asarray(schedule.factors[0, :, 0])
    control_map = np.asarray(pi.control_map(problem.system.G(jnp.zeros(2)), problem.cost.R))
    return float((control_map @ L)[0]) * weighted_increment(problem, L, temperature, start, steps)


def weighted_increment(
    problem: Problem, L: np.ndarray, temperature: float, start: np.ndarray, steps: int
) -> float:
    """Returns the mean of eps_0 / dt weighted by exp(-S / lambda), over (18) with L (2,).

    mu_k = F^k start + row_k eps, and S = sum over k of 1/2 |mu_k - goal|^2 dt plus the terminal
    cost. The covariance's share of the cost is the same for all paths.
    """
    A, _, cost = _arrays(problem)
    dt = INTEGRATOR_DURATION / steps
    F = np.eye(2) + A * dt

    # Means as affine functions of all increments.
    powers = [np.linalg.matrix_power(F, k) for k in range(steps + 1)]
    response = np.zeros((steps + 1, 2, steps))
    for k in range(1, steps + 1):
        response[k, :, :k] = np.stack([powers[k - 1 - j] @ L for j in range(k)], axis=-1)
    rows = response.reshape(-1, steps)
    deviation = (np.stack(powers) @ (start - np.asarray(cost.goal))).ravel()

    # The weighted law of the increments is Gaussian; its mean solves a linear system.
    running = np.tile(cost.running_weight, steps) * dt
    weight = np.concatenate([running, cost.terminal_weight]) / temperature
    precision = np.eye(steps) / dt + rows.T * weight @ rows
    gradient = rows.T @ (weight * deviation)
    return float(-np.linalg.solve(precision, gradient)[0] / dt)


def lqr_control(problem: Problem, start: np.ndarray) -> float:
    """Returns -R^-1 G' P(0) (start - goal) with -dP/dt = Q + A'P + PA - P G R^-1 G' P.

    The goal must be at rest, A goal = 0.
    """
    A, G, cost = _arrays(problem)
    RG = np.linalg.solve(cost.R, G.T)

    def rate(_: float, flat: np.ndarray) -> np.ndarray:
        P = flat.reshape(2, 2)
        return (np.diag(cost.running_weight) + A.T @ P + P @ A - P @ G @ RG @ P).ravel()

    terminal = np.diag(cost.terminal_weight).ravel()
    solution = solve_ivp(rate, (0, INTEGRATOR_DURATION), terminal, "DOP853", rtol=1e-12, atol=1e-13)
    P = solution.y[:, -1].reshape(2, 2)
    return float((-RG @ P @ (start - np.asarray(cost.goal)))[0])


def _arrays(problem: Problem) -> tuple[np.ndarray, np.ndarray, Any]:
    """Returns A, B and the cost of a linear problem."""
    system: Any = problem.system
    return np.asarray(system.A), np.asarray(system.B), problem.cost
