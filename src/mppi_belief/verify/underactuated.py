"""Theorem 6 for a diffusion of deficient rank: a double integrator with D = lambda G R^-1 G' of rank one.

    u_0 = sum_i w_i R^-1 G' (G R^-1 G')^+ L_0 eps_0^(i) / dt                         (19)

With a quadratic cost exp(-S / lambda) tilts the Gaussian eps into another, so the expectation of (19) is a matter
of dense linear algebra. All quantities are dimensionless.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

from ..costs import GoalObstacleCost
from ..planning import path_integral as pi
from ..problem import Problem
from ..results.certificate import Check
from ..systems import Linear
from .bands import order, rounding
from .matched_problem import Steady, matching_check, steady

DURATION = 1.0
STEPS = (10, 20, 40, 80)  # of the exact expectation
STATES = np.array([[0.0, 0.0], [-0.5, 0.5], [1.5, -0.5], [0.5, 1.0]])


def underactuated(steps: int = STEPS[0]) -> tuple[Problem, np.ndarray, float]:
    """Problem, Sigma (2, 2) and lambda; the state is [p, v], the control an acceleration.

    Sigma is the steady state of (8b) by construction: C = s G' Sigma^-1 with R_o = 1 makes K = s G, and
    Q = D - A Sigma - Sigma A'.
    """
    A, G = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    cov, strength, temperature = np.array([[0.5, -0.15], [-0.15, 0.3]]), 0.4, 0.5
    C = np.sqrt(strength) * np.linalg.solve(cov, G).T
    channel = np.linalg.cholesky(strength * G @ G.T - A @ cov - cov @ A.T)
    measured, noise = jnp.asarray(C), jnp.asarray(channel)
    system = Linear(jnp.asarray(A), jnp.asarray(G), measured, noise, jnp.ones(1))
    # a goal at rest, so that the distance from it moves as the state does
    goal, q, q_T, R = (
        jnp.array(v) for v in ([0.5, 0.0], [1.0, 0.3], [2.0, 0.5], [temperature / strength])
    )
    cost = GoalObstacleCost(goal, q, q_T, R)
    std = jnp.sqrt(jnp.diag(jnp.asarray(cov)))
    problem = Problem(
        system,
        cost,
        jnp.zeros(2),
        std,
        dt=DURATION / steps,
        steps=steps,
        noise_convention="intensity",
    )
    return problem, cov, temperature


def underactuated_checks() -> list[Check]:
    """That (19) is finite and right where D has no inverse."""
    problem, cov, temperature = underactuated()
    along = steady(problem, cov)
    distances = [
        float(
            np.linalg.norm(
                [exact(problem, along, temperature, x, H) - lqr(problem, x) for x in STATES]
            )
        )
        for H in STEPS
    ]
    return [
        *_algebra(problem, along, temperature),
        order(
            "D of rank 1: exact expectation of (19) against the Riccati equation, order in Δt",
            1,
            distances,
        ),
    ]


def _algebra(problem: Problem, along: Steady, temperature: float) -> list[Check]:
    """(15), and what the pseudoinverse makes of a disturbance in and outside the range of D."""
    G, R, D = problem.system.G(jnp.zeros(2)), problem.cost.R, jnp.asarray(along.diffusion[0])
    found = np.asarray(pi.control_map(G, R))
    printed = np.asarray(
        temperature * jnp.linalg.solve(R, G.T) @ jnp.linalg.pinv(D, hermitian=True)
    )
    outside = found @ (np.eye(2) - np.asarray(G @ jnp.linalg.pinv(G)))
    wrong = max(float(np.max(np.abs(found - printed))), float(np.max(np.abs(outside))))
    return [
        matching_check(
            "D of rank 1: largest residual ε of (15) along the gain schedule",
            problem,
            temperature,
            along,
        ),
        rounding(
            "control map of (19) less λR⁻¹G'D⁺, and what it makes of the rest of the space",
            wrong,
            1000,
        ),
    ]


def exact(
    problem: Problem, along: Steady, temperature: float, start: np.ndarray, steps: int
) -> float:
    """u, the expectation of (19)."""
    L = np.asarray(along.factors[0, :, 0])
    to_control = float(
        (np.asarray(pi.control_map(problem.system.G(jnp.zeros(2)), problem.cost.R)) @ L)[0]
    )
    return to_control * tilted_increment(problem, L, temperature, start, steps)


def tilted_increment(
    problem: Problem, L: np.ndarray, temperature: float, start: np.ndarray, steps: int
) -> float:
    """Mean of eps_0 / dt weighted by exp(-S / lambda), over (18) with L (2,).

    mu_k = F^k start + row_k eps with S = sum over k of 1/2 |mu_k - goal|^2 dt and the terminal cost; the covariance's
    share of the cost is the same for all paths.
    """
    dt, A, _, cost = DURATION / steps, *_parts(problem)
    F = np.eye(2) + A * dt
    powers = [np.linalg.matrix_power(F, k) for k in range(steps + 1)]
    pushed = np.zeros((steps + 1, 2, steps))
    for k in range(1, steps + 1):
        pushed[k, :, :k] = np.stack([powers[k - 1 - j] @ L for j in range(k)], axis=-1)
    rows, away = (
        pushed.reshape(-1, steps),
        (np.stack(powers) @ (start - np.asarray(cost.goal))).ravel(),
    )
    weight = (
        np.concatenate([np.tile(cost.running_weight, steps) * dt, cost.terminal_weight])
        / temperature
    )
    precision, slope = np.eye(steps) / dt + rows.T * weight @ rows, rows.T @ (weight * away)
    return float(-np.linalg.solve(precision, slope)[0] / dt)


def lqr(problem: Problem, start: np.ndarray) -> float:
    """-R^-1 G' P(0) (start - goal) with -dP/dt = Q + A'P + PA - P G R^-1 G' P; needs A goal = 0."""
    A, G, cost = _parts(problem)
    gain = np.linalg.solve(cost.R, G.T)

    def rate(_: float, flat: np.ndarray) -> np.ndarray:
        P = flat.reshape(2, 2)
        return (np.diag(cost.running_weight) + A.T @ P + P @ A - P @ G @ gain @ P).ravel()

    end = np.diag(cost.terminal_weight).ravel()
    P = solve_ivp(rate, (0, DURATION), end, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1].reshape(2, 2)
    return float((-gain @ P @ (start - np.asarray(cost.goal)))[0])


def _parts(problem: Problem) -> tuple[np.ndarray, np.ndarray, Any]:
    system: Any = problem.system
    return np.asarray(system.A), np.asarray(system.B), problem.cost
