"""Algorithm 1 written out for a moving light-dark vehicle, where D_t, Sigma_t and q_t vary.

    dSigma = A Sigma + Sigma A' + Q - D                                      line 1, (11)
    D_k    = Sigma_k C' R_o(mean_k)^-1 C Sigma_k = L_k L_k'                  line 1, (9)
    M_0    = R^-1 G' (G R^-1 G')^+ L_0                                       line 3
    mu_k+1 = mu_k + f(mu_k) dt + L_k eps_k                                   lines 5 to 11
    S      = sum_k q_k(mu_k) dt + phi(mu_H)                                  lines 5 to 11
    u_0    = M_0 sum_i w_i eps_0^(i) / dt,    w_i ~ exp(-S_i / lambda)       lines 12 to 15

This module uses NumPy and SciPy, `MPPI` the package, and both the same normals, so that they
differ by rounding only. The expectations in q_k are sums over an even grid, exact for Gaussians. Of
the package only the signs of L_k are used, which are arbitrary.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.linalg import expm

from ...belief.schedule import diffusion_factors, gain_schedule
from ...controllers import MPPI
from ...costs import GoalObstacleCost
from ...costs.penalties import Bump
from ...obstacles import Obstacles
from ...planning import path_integral as pi
from ...problem import Belief, Problem
from ...results.certificate import Check
from ...systems import LightDark
from ..bands import rounding
from ..compilation import quick_jit
from ..estimates import largest_magnitude
from .matched_paths import printed_algorithm

HAND_STEPS = 8
HAND_SAMPLES = 64
HAND_TEMPERATURE = 0.7
HAND_THETA = 0.3
HAND_STARTS = np.array([[2.2, 0.9, 0.6, -0.3], [2.7, -0.4, 0.9, 0.2], [3.4, 0.6, 0.8, 0.4]])
HAND_COV = np.array(
    [[0.3, 0.05, 0.2, 0.0], [0.05, 0.15, 0.0, 0.1], [0.2, 0.0, 0.4, 0.05], [0.0, 0.1, 0.05, 0.3]]
)
HAND_AXIS = np.arange(-8.5, 8.6, 0.25)  # standard deviations; the tails beyond are below rounding
VEHICLE_A = np.eye(4, k=2)
VEHICLE_C = np.eye(2, 4)


class PackageRun(NamedTuple):
    """Holds the package's results from each start."""

    control: np.ndarray  # (starts, nu), u_0
    factors: np.ndarray  # (starts, H, nx, nx), L_k
    eps: np.ndarray  # (starts, H, nx, N), the Brownian increments


class HandRun(NamedTuple):
    """Holds the results of Algorithm 1 by hand from one start."""

    control: np.ndarray  # (nu,), u_0
    largest: float  # largest control increment
    costs: np.ndarray  # (N,), path costs over lambda
    factor_error: float  # largest relative error of L_k L_k'


def moving_problem() -> Problem:
    """Returns the problem of a vehicle that comes out of the dark between two obstacles."""
    cost = GoalObstacleCost(
        goal=jnp.array([4.0, 0.0, 0.0, 0.0]),
        running_weight=jnp.array([1.5, 1.0, 0.6, 0.4]),
        terminal_weight=jnp.array([2.0, 2.0, 0.5, 0.3]),
        control_weight=jnp.array([0.5, 0.4]),
        w_obs=8.0,
        obstacle_penalty=Bump(0.5),
    )
    return Problem(
        LightDark(process_noise=0.3, light=5.0, noise_slope=0.25, noise_floor=0.1),
        cost,
        prior_mean=jnp.zeros(4),
        prior_std=jnp.ones(4),
        dt=0.1,
        steps=HAND_STEPS,
        obstacles=Obstacles(jnp.array([[3.0, 1.0], [3.0, -1.0]]), 0.65),
        position=(0, 1),
        noise_convention="intensity",
    )


def line_by_line_check(key: Array) -> Check:
    """Returns the check that the package and the hand-written algorithm agree from every start."""
    problem = moving_problem()
    run = package_run(problem, key)
    by_hand = [
        hand_run(problem, start, factors, eps)
        for start, factors, eps in zip(HAND_STARTS, run.factors, run.eps, strict=True)
    ]
    error = max(hand.factor_error for hand in by_hand)
    for u, hand in zip(run.control, by_hand, strict=True):
        error = max(error, largest_magnitude(u - hand.control) / hand.largest)
    # S sums over nodes and steps, and its rounding over lambda is the relative one of a weight.
    operations = 2 * len(HAND_AXIS) ** 2 * HAND_STEPS
    scale = max(float(hand.costs.max()) for hand in by_hand)
    return rounding(
        "Algorithm 1 line by line, same normals, D_k and Σ_k in transit: L_kL_k' and u₀, relative",
        error,
        operations,
        scale,
    )


def package_run(problem: Problem, key: Array) -> PackageRun:
    """Returns what MPPI-Belief computes from every start."""
    planner = printed_algorithm(HAND_SAMPLES, problem, HAND_TEMPERATURE, theta=HAND_THETA)
    keys = jax.random.split(key, len(HAND_STARTS))
    results = quick_jit(planned_controls)(planner, problem, HAND_STARTS, HAND_COV, keys)
    return PackageRun(*(np.asarray(result) for result in results))


def planned_controls(
    planner: MPPI, problem: Problem, starts: Array, cov: Array, keys: Array
) -> tuple[Array, Array, Array]:
    """Returns u_0, L_k and eps as in `PackageRun`."""
    plan = planner.init(problem)

    def from_start(inputs: tuple[Array, Array]) -> tuple[Array, Array, Array]:
        mean, key = inputs
        belief = Belief(mean, cov)
        factors, _ = diffusion_factors(gain_schedule(problem, belief, plan, "riccati"))
        eps = jnp.sqrt(problem.dt) * pi.normals(key, (HAND_STEPS, 4, HAND_SAMPLES), False)
        return planner.act(problem, belief, plan, key)[0], factors, eps

    return jax.lax.map(from_start, (starts, keys))


def riccati_by_hand(problem: Problem, mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns Sigma_k (H+1, 4, 4) and D_k (H, 4, 4) along the uncontrolled mean: line 1.

    R_o is constant over each step.
    """
    system: Any = problem.system
    Q = np.diag([0.0, 0.0, 1.0, 1.0]) * system.process_noise**2
    covs = [HAND_COV]
    diffusions = []
    for _ in range(HAND_STEPS):
        sigma_o = system.noise_slope * abs(mean[0] - system.light) + system.noise_floor
        information = VEHICLE_C.T @ VEHICLE_C / sigma_o**2
        hamiltonian = np.block([[-VEHICLE_A.T, information], [Q, VEHICLE_A]])
        flow = expm(hamiltonian * problem.dt) @ np.vstack([np.eye(4), covs[-1]])
        diffusions.append(covs[-1] @ information @ covs[-1])
        covs.append(flow[4:] @ np.linalg.inv(flow[:4]))
        mean = mean + VEHICLE_A @ mean * problem.dt
    return np.array(covs), np.array(diffusions)


def risk_by_hand(problem: Problem, mu: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """Returns q_RS (N,) of means (4, N).

    The quadratic is that of (4); expectation and variance of the bumps are sums over a grid.
    """
    cost: Any = problem.cost
    obstacles: Any = problem.obstacles
    Q = np.diag(cost.running_weight)
    deviation = mu - np.asarray(cost.goal)[:, None]

    # The grid of positions around each mean, and its normalised weights.
    z = np.stack(np.meshgrid(HAND_AXIS, HAND_AXIS)).reshape(2, -1)
    weights = np.exp(-np.sum(z**2, axis=0) / 2)
    weights /= weights.sum()
    points = mu[:2, :, None] + (np.linalg.cholesky(cov[:2, :2]) @ z)[:, None]

    # Moments of the obstacle bumps.
    squares = [
        np.sum((points - np.asarray(centre)[:, None, None]) ** 2, axis=0)
        for centre in obstacles.centers
    ]
    width = cost.obstacle_penalty.width
    bumps = cost.w_obs * sum(np.exp(-square / (2 * width**2)) for square in squares)
    mean = bumps @ weights
    variance = (bumps - mean[:, None]) ** 2 @ weights

    expected_quadratic = (np.sum(deviation * (Q @ deviation), axis=0) + np.trace(Q @ cov)) / 2
    q_rs: np.ndarray = expected_quadratic + mean + HAND_THETA / 2 * variance
    return q_rs


def hand_run(problem: Problem, start: np.ndarray, L: np.ndarray, eps: np.ndarray) -> HandRun:
    """Returns Algorithm 1 by hand for L_k (H, 4, 4) and eps (H, 4, N)."""
    cost: Any = problem.cost

    # Lines 1 to 3.
    covs, diffusions = riccati_by_hand(problem, start)
    G = np.eye(4, 2, k=-2)
    RG = np.linalg.solve(cost.R, np.eye(2, 4, k=2))
    M = RG @ np.linalg.pinv(G @ RG) @ L[0]

    # Lines 4 to 11: rollouts and their costs.
    mu = np.repeat(start[:, None], HAND_SAMPLES, axis=1)
    S = np.zeros(HAND_SAMPLES)
    for k in range(HAND_STEPS):
        S += risk_by_hand(problem, mu, covs[k]) * problem.dt
        mu = mu + VEHICLE_A @ mu * problem.dt + L[k] @ eps[k]
    Q_T = np.diag(cost.terminal_weight)
    deviation = mu - np.asarray(cost.goal)[:, None]
    S += (np.sum(deviation * (Q_T @ deviation), axis=0) + np.trace(Q_T @ covs[-1])) / 2

    # Lines 12 to 15: weights and the first control.
    w = np.exp((S.min() - S) / HAND_TEMPERATURE)
    increments = M @ eps[0] / problem.dt

    factor_errors = np.linalg.norm(L @ L.transpose(0, 2, 1) - diffusions, axis=(1, 2))
    relative_errors = factor_errors / np.linalg.norm(diffusions, axis=(1, 2))
    return HandRun(
        control=increments @ w / w.sum(),
        largest=largest_magnitude(increments),
        costs=S / HAND_TEMPERATURE,
        factor_error=float(np.max(relative_errors)),
    )
