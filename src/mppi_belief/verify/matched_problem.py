"""One matched problem for several certificates: scalar, at the filter's steady state, its cost not quadratic.

    0 = 2 a Sigma + sigma_w^2 - D,   D = (c Sigma / sigma_o)^2 = lambda b^2 / R      (8b)(9)(15)

Sigma stays at the root of (8b), so D is constant and R = lambda b^2 / D makes (15) hold at all times. The running
cost has its goal between two obstacles and is risk-sensitive (Remark 4). All quantities are dimensionless.
"""

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..belief.cost import expected_terminal, risk_sensitive
from ..belief.schedule import diffusion_factors, gain_schedule
from ..controllers import MPPI
from ..costs import GoalObstacleCost
from ..matching.weights import matched_weight, residual
from ..obstacles import Obstacles
from ..planning import path_integral as pi
from ..planning.path_costs import RiskSensitive
from ..planning.samplers import InnovationSampler
from ..planning.schedules import SharedCovariance
from ..problem import Belief, Problem
from ..results.certificate import Check
from ..systems import ScalarLinear
from .bands import rounding
from .compilation import quick_jit
from .pde import Equation, Quadratic

REACH = 7.0  # of the grids; from there the optimum does not come near the obstacles before T
BLOCK = 4096  # grid points whose cost is computed at once, so that grids of any size compile once
POOL = 2**17  # paths sampled at once


class Matched(NamedTuple):
    """A problem and what the planner adds to it."""

    problem: Problem
    temperature: float
    theta: float
    cov: np.ndarray  # the steady state (1, 1)

    @property
    def duration(self) -> float:
        """T."""
        return self.problem.dt * self.problem.steps


def matched_problem(
    w_obs: float = 3.0, theta: float = 0.5, temperature: float = 0.6, steps: int = 10
) -> Matched:
    """The problem over one unit of time; w_obs = 0 and theta = 0 make it linear-quadratic."""
    a, b, c, sigma_w, sigma_o = 0.3, 0.8, 1.2, 0.7, 0.5
    seen = (c / sigma_o) ** 2
    variance = (a + np.sqrt(a**2 + seen * sigma_w**2)) / seen
    R = temperature * b**2 / (seen * variance**2)
    system = ScalarLinear(a, b, c, sigma_w, sigma_o)
    obstacles = Obstacles(jnp.array([[-0.6], [1.1]]), 0.1)
    goal, q, q_T, weight = (jnp.array([number]) for number in (0.3, 1.0, 0.9, R))
    cost = GoalObstacleCost(goal, q, q_T, weight, w_obs=w_obs, bump_width=0.3)
    problem = Problem(
        system,
        cost,
        jnp.zeros(1),
        jnp.sqrt(jnp.array([variance])),
        dt=1.0 / steps,
        steps=steps,
        obstacles=obstacles,
        noise_convention="intensity",
    )
    return Matched(problem, temperature, theta, np.array([[variance]]))


def with_grid(matched: Matched, duration: float, steps: int) -> Problem:
    """The same problem over another time, in other steps."""
    return replace(matched.problem, dt=duration / steps, steps=steps)


def running(problem: Problem, theta: Array | float, mean: Array, cov: Array) -> Array:
    """q_RS () of Remark 4, the variance that of the whole cost."""
    return risk_sensitive(problem, mean, cov, theta, variance_of="total")


class Steady(NamedTuple):
    """The schedule of Assumption 1, which the steady state keeps: Sigma (T+1, nx, nx), D and L (T, nx, nx), ranks (T,).
    That of fewer steps is its beginning, however long they are."""

    cov: Array
    diffusion: Array
    factors: Array
    ranks: Array


def steady(problem: Problem, cov: np.ndarray) -> Steady:
    """The package's gain schedule from Sigma (nx, nx) without control."""
    nx, nu = problem.cost.goal.shape[0], problem.cost.R.shape[0]
    return _schedule(problem, np.zeros(nx), cov, np.zeros((problem.steps, nu)))


@quick_jit
def _schedule(problem: Problem, mean: Array, cov: Array, controls: Array) -> Steady:
    schedule = gain_schedule(problem, Belief(mean, cov), controls, "riccati")
    return Steady(schedule.cov, schedule.diffusion, *diffusion_factors(schedule))


def equation(matched: Matched, along: Steady) -> Equation:
    """The terms of (13) and (16), read from the package's functions."""
    problem = matched.problem
    system = problem.system
    cost: Any = problem.cost
    G = np.asarray(system.G(jnp.zeros(1)))
    away = replace(problem, cost=replace(cost, w_obs=0.0))
    far = _reduced_costs(away, matched, np.array([-1.0, 0.0, 1.0]))
    return Equation(
        drift=float(system.f(jnp.ones(1))[0]),
        diffusion=float(along.diffusion[0, 0, 0]),
        authority=float((G @ np.linalg.solve(cost.R, G.T))[0, 0]),
        temperature=matched.temperature,
        duration=matched.duration,
        reach=REACH,
        running=lambda mu: _reduced_costs(problem, matched, mu)[0],
        terminal=lambda mu: _reduced_costs(problem, matched, mu)[1],
        far_running=_through(far[0]),
        far_terminal=_through(far[1]),
    )


def _through(at: np.ndarray) -> Quadratic:
    """The quadratic with these values (3,) at -1, 0, 1."""
    left, centre, right = (float(v) for v in at)
    return Quadratic(centre, (right - left) / 2, right - 2 * centre + left)


def _reduced_costs(problem: Problem, matched: Matched, mu: np.ndarray) -> np.ndarray:
    """q and phi (2, n) at means (n,)."""
    blocks = np.pad(np.asarray(mu, dtype=float), (0, -len(mu) % BLOCK)).reshape(-1, BLOCK, 1)
    found = [
        np.asarray(_costs_of_block(problem, matched.theta, block, matched.cov)) for block in blocks
    ]
    return np.concatenate(found, axis=1)[:, : len(mu)]


@quick_jit
def _costs_of_block(problem: Problem, theta: Array, means: Array, cov: Array) -> Array:
    def both(mu: Array) -> Array:
        return jnp.stack([running(problem, theta, mu, cov), expected_terminal(problem, mu, cov)])

    return jax.vmap(both, out_axes=1)(means)


def sampled_costs(
    problem: Problem, theta: Array | float, mean: Array, along: Steady, eps: Array
) -> tuple[Array, Array]:
    """Lines 4 to 11 of Algorithm 1 for Brownian increments eps (H, nx, N): path costs (N,) and L eps (H, nx, N)."""
    H, _, N = eps.shape
    disturbance = jnp.einsum("hij,hjn->hin", along.factors[:H], eps)
    means = pi.rollouts(problem, mean, jnp.zeros((H, problem.cost.R.shape[0], N)), disturbance)
    costs = pi.accumulated_costs(
        problem,
        mean,
        means,
        along.cov[: H + 1],
        False,
        lambda mu, at: running(problem, theta, mu, at),
        lambda mu, at: expected_terminal(problem, mu, at),
    )
    return costs, disturbance


@partial(jax.jit, static_argnames=("steps", "n_samples"))
def _pool(
    matched: Matched, mean: Array, along: Steady, key: Array, steps: int, n_samples: int
) -> tuple[Array, Array]:
    eps = jnp.sqrt(matched.problem.dt) * pi.normals(key, (steps, 1, n_samples), False)
    costs, disturbance = sampled_costs(matched.problem, matched.theta, mean, along, eps)
    G, R = matched.problem.system.G(mean), matched.problem.cost.R
    return costs, (pi.control_map(G, R) @ disturbance[0] / matched.problem.dt)[0]


def pooled_costs(
    matched: Matched, along: Steady, mean: float, key: Array, paths: int
) -> tuple[np.ndarray, np.ndarray]:
    """Costs S (paths,) of independent paths of (18) from one mean, and their first control increments (paths,)."""
    count = -(-paths // POOL)
    parts = [
        _pool(matched, np.array([mean]), along, k, matched.problem.steps, POOL)
        for k in jax.random.split(key, count)
    ]
    costs, increments = (
        np.concatenate([np.asarray(part[j]) for part in parts])[:paths] for j in (0, 1)
    )
    return costs, increments


def algorithm_1(samples: int, problem: Problem, temperature: float, **options: Any) -> MPPI:
    """Returns Algorithm 1 as printed, over the whole problem; `options` are those of `RiskSensitive`."""
    path_cost = RiskSensitive(at_step_end=False, **options)
    schedule = SharedCovariance(method="riccati")
    return MPPI(samples, problem.steps, temperature, path_cost, InnovationSampler(), schedule)


def first_controls(planner: MPPI, problem: Problem, means: Array, cov: Array, keys: Array) -> Array:
    """u_0 (keys, means, nu) of the planner at means (means, nx) and Sigma (nx, nx), from its first plan."""
    plan = planner.init(problem)

    def at(mean: Array, key: Array) -> Array:
        return planner.act(problem, Belief(mean, cov), plan, key)[0]

    return jax.lax.map(lambda key: jax.vmap(at, in_axes=(0, None))(means, key), keys)


def matching_check(computed: str, problem: Problem, temperature: float, along: Steady) -> Check:
    """The largest residual of (15) along a schedule."""
    G, W = problem.system.G(problem.prior_mean), matched_weight(problem.cost.R, temperature)
    worst = jnp.max(jax.vmap(residual, (0, None, None))(along.diffusion, G, W))
    # each step solves the Riccati equation by some tens of operations
    return rounding(computed, float(worst), 100 * len(along.diffusion))
