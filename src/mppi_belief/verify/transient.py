"""Algorithm 1 line by line where D_t, Sigma_t and q_t vary: light-dark at speed, its belief not at rest.

    dSigma = A Sigma + Sigma A' + Q - D,   D_k = Sigma_k C' R_o(mean_k)^-1 C Sigma_k = L_k L_k'   line 1, (9)(11)
    M_0    = R^-1 G' (G R^-1 G')^+ L_0                                                      line 3
    mu_k+1 = mu_k + f(mu_k) dt + L_k eps_k,   S = sum_k q_k(mu_k) dt + phi(mu_H)            lines 5 to 11
    u_0    = M_0 sum_i w_i eps_0^(i) / dt,    w_i ~ exp(-S_i / lambda)                      lines 12 to 15

NumPy and SciPy here, `MPPI` there, from the same normals: what differs is rounding. The expectations in q_k are
sums over an even grid, exact for Gaussians; of the package only the signs of L_k are taken, which are free.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.linalg import expm

from ..belief.schedule import diffusion_factors, gain_schedule
from ..controllers import MPPI
from ..costs import GoalObstacleCost
from ..obstacles import Obstacles
from ..planning import path_integral as pi
from ..problem import Belief, Problem
from ..results.certificate import Check
from ..systems import LightDark
from .bands import rounding
from .compilation import quick_jit
from .matched_problem import algorithm_1

STEPS, SAMPLES, TEMPERATURE, THETA = 8, 64, 0.7, 0.3
STARTS = np.array([[2.2, 0.9, 0.6, -0.3], [2.7, -0.4, 0.9, 0.2], [3.4, 0.6, 0.8, 0.4]])
COV = np.array(
    [[0.3, 0.05, 0.2, 0.0], [0.05, 0.15, 0.0, 0.1], [0.2, 0.0, 0.4, 0.05], [0.0, 0.1, 0.05, 0.3]]
)
AXIS = np.arange(-8.5, 8.6, 0.25)  # standard deviations: what is left out is below rounding


class Run(NamedTuple):
    """From each start: u_0 (starts, nu) and L_k (starts, H, nx, nx) of the package, its eps (starts, H, nx, N)."""

    control: np.ndarray
    factors: np.ndarray
    eps: np.ndarray


class Printed(NamedTuple):
    """From one start: u_0 (nu,), the largest control increment, the costs over lambda (N,), and the largest relative
    error of L_k L_k'."""

    control: np.ndarray
    largest: float
    costs: np.ndarray
    factor_error: float


def transient_problem() -> Problem:
    """The vehicle comes out of the dark between two obstacles."""
    centers = jnp.array([[3.0, 1.0], [3.0, -1.0]])
    numbers = ([4.0, 0.0, 0.0, 0.0], [1.5, 1.0, 0.6, 0.4], [2.0, 2.0, 0.5, 0.3], [0.5, 0.4])
    goal, q, q_T, R = (jnp.array(v) for v in numbers)
    cost = GoalObstacleCost(goal, q, q_T, R, w_obs=8.0, bump_width=0.5)
    system = LightDark(0.3, 5.0, 0.25, 0.1)
    return Problem(
        system,
        cost,
        jnp.zeros(4),
        jnp.ones(4),
        dt=0.1,
        steps=STEPS,
        obstacles=Obstacles(centers, 0.65),
        position=(0, 1),
        noise_convention="intensity",
    )


def transient_check(key: Array) -> Check:
    """Both ways from every start."""
    problem = transient_problem()
    found = run(problem, key)
    by_hand = [
        printed(problem, *each) for each in zip(STARTS, found.factors, found.eps, strict=True)
    ]
    error = max(p.factor_error for p in by_hand)
    for u, p in zip(found.control, by_hand, strict=True):
        error = max(error, float(np.max(np.abs(u - p.control))) / p.largest)
    # S sums over nodes and steps, and its rounding over lambda is the relative one of a weight
    operations, scale = 2 * len(AXIS) ** 2 * STEPS, max(float(p.costs.max()) for p in by_hand)
    return rounding(
        "Algorithm 1 line by line, same normals, D_k and Σ_k in transit: L_kL_k' and u₀, relative",
        error,
        operations,
        scale,
    )


def run(problem: Problem, key: Array) -> Run:
    """MPPI-Belief from every start."""
    planner = algorithm_1(SAMPLES, problem, TEMPERATURE, theta=THETA)
    keys = jax.random.split(key, len(STARTS))
    return Run(*(np.asarray(part) for part in quick_jit(_run)(planner, problem, STARTS, COV, keys)))


def _run(
    planner: MPPI, problem: Problem, starts: Array, cov: Array, keys: Array
) -> tuple[Array, Array, Array]:
    plan = planner.init(problem)

    def at(given: tuple[Array, Array]) -> tuple[Array, Array, Array]:
        belief, key = Belief(given[0], cov), given[1]
        factors, _ = diffusion_factors(gain_schedule(problem, belief, plan, "riccati"))
        eps = jnp.sqrt(problem.dt) * pi.normals(key, (STEPS, 4, SAMPLES), False)
        return planner.act(problem, belief, plan, key)[0], factors, eps

    return jax.lax.map(at, (starts, keys))


def riccati(problem: Problem, mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Line 1: Sigma_k (H+1, 4, 4) and D_k (H, 4, 4) along the uncontrolled mean, R_o frozen over each step."""
    system: Any = problem.system
    A, C, Q = np.eye(4, k=2), np.eye(2, 4), np.diag([0.0, 0.0, 1.0, 1.0]) * system.process_noise**2
    covs, diffusions = [COV], []
    for _ in range(STEPS):
        seen = (
            C.T @ C / (system.noise_slope * abs(mean[0] - system.light) + system.noise_floor) ** 2
        )
        flow = expm(np.block([[-A.T, seen], [Q, A]]) * problem.dt) @ np.vstack(
            [np.eye(4), covs[-1]]
        )
        diffusions.append(covs[-1] @ seen @ covs[-1])
        covs.append(flow[4:] @ np.linalg.inv(flow[:4]))
        mean = mean + A @ mean * problem.dt
    return np.array(covs), np.array(diffusions)


def running(problem: Any, mu: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """q_RS (N,) of means (4, N): the quadratic by (4), expectation and variance of the bumps as sums over a grid."""
    cost = problem.cost
    Q, away = np.diag(cost.running_weight), mu - np.asarray(cost.goal)[:, None]
    z = np.stack(np.meshgrid(AXIS, AXIS)).reshape(2, -1)
    weights = np.exp(-np.sum(z**2, axis=0) / 2)
    weights /= weights.sum()
    points = mu[:2, :, None] + (np.linalg.cholesky(cov[:2, :2]) @ z)[:, None]
    squares = [
        np.sum((points - np.asarray(c)[:, None, None]) ** 2, axis=0)
        for c in problem.obstacles.centers
    ]
    bumps = cost.w_obs * sum(np.exp(-square / (2 * cost.bump_width**2)) for square in squares)
    mean = bumps @ weights
    variance = (bumps - mean[:, None]) ** 2 @ weights
    expected: np.ndarray = (
        (np.sum(away * (Q @ away), axis=0) + np.trace(Q @ cov)) / 2 + mean + THETA / 2 * variance
    )
    return expected


def printed(problem: Problem, start: np.ndarray, L: np.ndarray, eps: np.ndarray) -> Printed:
    """Algorithm 1 for L_k (H, 4, 4) and eps (H, 4, N)."""
    cost: Any = problem.cost
    covs, diffusions = riccati(problem, start)
    A, G, weighted = np.eye(4, k=2), np.eye(4, 2, k=-2), np.linalg.solve(cost.R, np.eye(2, 4, k=2))
    M = weighted @ np.linalg.pinv(G @ weighted) @ L[0]
    mu, S = np.repeat(start[:, None], SAMPLES, axis=1), np.zeros(SAMPLES)
    for k in range(STEPS):
        S += running(problem, mu, covs[k]) * problem.dt
        mu = mu + A @ mu * problem.dt + L[k] @ eps[k]
    Q_T, away = np.diag(cost.terminal_weight), mu - np.asarray(cost.goal)[:, None]
    S += (np.sum(away * (Q_T @ away), axis=0) + np.trace(Q_T @ covs[-1])) / 2
    w = np.exp((S.min() - S) / TEMPERATURE)
    increments = M @ eps[0] / problem.dt
    wrong = np.linalg.norm(L @ L.transpose(0, 2, 1) - diffusions, axis=(1, 2)) / np.linalg.norm(
        diffusions, axis=(1, 2)
    )
    return Printed(
        increments @ w / w.sum(),
        float(np.max(np.abs(increments))),
        S / TEMPERATURE,
        float(np.max(wrong)),
    )
