"""A matched scalar problem at the filter's steady state, with a cost that is not quadratic.

    0 = 2 a Sigma + sigma_w^2 - D,   D = (c Sigma / sigma_o)^2 = lambda b^2 / R      (8b)(9)(15)

Sigma stays at the root of (8b), so that D is constant, and R = lambda b^2 / D makes (15) hold at
all times. The goal of the running cost lies between two obstacles, and the cost is risk-sensitive
(Remark 4). All quantities are dimensionless.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...belief.cost import expected_terminal, risk_sensitive
from ...belief.schedule import diffusion_factors, gain_schedule
from ...costs import GoalObstacleCost
from ...costs.penalties import Bump
from ...matching.weights import matched_weight, residual
from ...obstacles import Obstacles
from ...problem import Belief, Problem
from ...results.certificate import Check
from ...systems import ScalarLinear
from ..bands import rounding
from ..compilation import quick_jit
from ..solvers.scalar_equations import Quadratic, ScalarEquation

# Half width of the grids; from there the optimum does not come near the obstacles before T.
GRID_REACH = 7.0
# Grid points whose cost is computed at once, so that grids of any size compile once.
COST_BLOCK = 4096


class MatchedProblem(NamedTuple):
    """Holds a problem and what the planner adds to it."""

    problem: Problem
    temperature: float  # lambda
    theta: float  # risk aversion of Remark 4
    cov: np.ndarray  # (1, 1), the steady state of the filter

    @property
    def duration(self) -> float:
        """Returns T."""
        return self.problem.dt * self.problem.steps


class SteadySchedule(NamedTuple):
    """Holds the schedule of Assumption 1, which is constant at the steady state.

    The schedule of fewer steps is its beginning, however long these are.
    """

    cov: Array  # (T+1, nx, nx), Sigma
    diffusion: Array  # (T, nx, nx), D
    factors: Array  # (T, nx, nx), L
    ranks: Array  # (T,), ranks of D


def matched_problem(
    w_obs: float = 3.0, theta: float = 0.5, temperature: float = 0.6, steps: int = 10
) -> MatchedProblem:
    """Returns the problem over unit time; w_obs = 0 and theta = 0 make it linear-quadratic."""
    a = 0.3
    b = 0.8
    c = 1.2
    sigma_w = 0.7
    sigma_o = 0.5

    # The steady state of (8b), and the R that matches its D.
    information = (c / sigma_o) ** 2
    variance = (a + np.sqrt(a**2 + information * sigma_w**2)) / information
    R = temperature * b**2 / (information * variance**2)

    system = ScalarLinear(a, b, c, sigma_w, sigma_o)
    cost = GoalObstacleCost(
        goal=jnp.array([0.3]),
        running_weight=jnp.array([1.0]),
        terminal_weight=jnp.array([0.9]),
        control_weight=jnp.array([R]),
        w_obs=w_obs,
        obstacle_penalty=Bump(0.3),
    )
    problem = Problem(
        system,
        cost,
        prior_mean=jnp.zeros(1),
        prior_std=jnp.sqrt(jnp.array([variance])),
        dt=1.0 / steps,
        steps=steps,
        obstacles=Obstacles(jnp.array([[-0.6], [1.1]]), 0.1),
        noise_convention="intensity",
    )
    return MatchedProblem(problem, temperature, theta, np.array([[variance]]))


def with_time_grid(matched: MatchedProblem, duration: float, steps: int) -> Problem:
    """Returns the same problem over another duration, in another number of steps."""
    return replace(matched.problem, dt=duration / steps, steps=steps)


def total_risk(problem: Problem, theta: Array | float, mean: Array, cov: Array) -> Array:
    """Returns q_RS () of Remark 4 with the variance of the whole running cost."""
    return risk_sensitive(problem, mean, cov, theta, variance_of="total")


def steady_schedule(problem: Problem, cov: np.ndarray) -> SteadySchedule:
    """Returns the package's gain schedule from Sigma (nx, nx) without control."""
    nx = problem.cost.goal.shape[0]
    nu = problem.cost.R.shape[0]
    return _uncontrolled_schedule(problem, np.zeros(nx), cov, np.zeros((problem.steps, nu)))


@quick_jit
def _uncontrolled_schedule(
    problem: Problem, mean: Array, cov: Array, controls: Array
) -> SteadySchedule:
    schedule = gain_schedule(problem, Belief(mean, cov), controls, "riccati")
    return SteadySchedule(schedule.cov, schedule.diffusion, *diffusion_factors(schedule))


def scalar_equation(matched: MatchedProblem, schedule: SteadySchedule) -> ScalarEquation:
    """Returns the terms of (13) and (16), read from the package's functions."""
    problem = matched.problem
    system = problem.system
    cost: Any = problem.cost
    G = np.asarray(system.G(jnp.zeros(1)))
    without_obstacles = replace(problem, cost=replace(cost, w_obs=0.0))
    far = _reduced_costs(without_obstacles, matched, np.array([-1.0, 0.0, 1.0]))
    return ScalarEquation(
        drift=float(system.f(jnp.ones(1))[0]),
        diffusion=float(schedule.diffusion[0, 0, 0]),
        authority=float((G @ np.linalg.solve(cost.R, G.T))[0, 0]),
        temperature=matched.temperature,
        duration=matched.duration,
        reach=GRID_REACH,
        running=lambda mu: _reduced_costs(problem, matched, mu)[0],
        terminal=lambda mu: _reduced_costs(problem, matched, mu)[1],
        far_running=_interpolating_quadratic(far[0]),
        far_terminal=_interpolating_quadratic(far[1]),
    )


def _interpolating_quadratic(values: np.ndarray) -> Quadratic:
    """Returns the quadratic with these values (3,) at -1, 0 and 1."""
    below, centre, above = (float(value) for value in values)
    return Quadratic(centre, (above - below) / 2, above - 2 * centre + below)


def _reduced_costs(problem: Problem, matched: MatchedProblem, mu: np.ndarray) -> np.ndarray:
    """Returns q and phi (2, n) at means (n,)."""
    padded = np.pad(np.asarray(mu, dtype=float), (0, -len(mu) % COST_BLOCK))
    parts = [
        np.asarray(_costs_of_block(problem, matched.theta, block, matched.cov))
        for block in padded.reshape(-1, COST_BLOCK, 1)
    ]
    return np.concatenate(parts, axis=1)[:, : len(mu)]


@quick_jit
def _costs_of_block(problem: Problem, theta: Array, means: Array, cov: Array) -> Array:
    def both(mu: Array) -> Array:
        return jnp.stack([total_risk(problem, theta, mu, cov), expected_terminal(problem, mu, cov)])

    return jax.vmap(both, out_axes=1)(means)


def matching_check(
    computed: str, problem: Problem, temperature: float, schedule: SteadySchedule
) -> Check:
    """Returns the check of the largest residual of (15) along a schedule."""
    G = problem.system.G(problem.prior_mean)
    W = matched_weight(problem.cost.R, temperature)
    largest = jnp.max(jax.vmap(residual, (0, None, None))(schedule.diffusion, G, W))
    # Each step solves the Riccati equation by some tens of operations.
    return rounding(computed, float(largest), 100 * len(schedule.diffusion))
