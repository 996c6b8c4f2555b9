"""Costs and beliefs for the comparison of q_RS of Remark 4 with the entropic risk.

    q_RS = E[q] + theta/2 Var[q],        rho - q_RS = theta^2/6 kappa_3 + theta^3/24 kappa_4 + ...

kappa_n are the cumulants of q(x), x ~ N(mu, Sigma). The obstacle penalty has the numbers of conf/;
it depends on the position alone.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...belief.cost import risk_sensitive, running_moments
from ...costs import GoalObstacleCost
from ...costs.penalties import Bump
from ...obstacles import Obstacles
from ...problem import Belief, Problem
from ...systems import Linear
from .cost_laws import CostLaw, QuadraticLaw, plane_law
from .section_vii import bump_cost_numbers, problem_numbers

BELIEF_DISTANCE = 0.8  # m, of the examined belief from an obstacle's centre
BELIEF_STD = 0.35  # m, standard deviation of the examined belief
FINE_STEP = 0.0125  # of the sums, in standard deviations; resolves theta w_obs = 900
COARSE_STEP = 0.1  # of the sums for small theta
THETA_HALVINGS = 2.0 ** -np.arange(6)


class RiskExpansion(NamedTuple):
    """Holds a cost under a belief, its risk-sensitive cost and its entropic risk."""

    name: str
    law: CostLaw
    thetas: np.ndarray  # (T,)
    expanded: np.ndarray  # (T,), q_RS of the package
    exact: np.ndarray  # (T,), rho

    @property
    def errors(self) -> np.ndarray:
        """Returns rho - q_RS (T,)."""
        return self.exact - self.expanded


def obstacle_centers() -> list[list[float]]:
    """Returns the centres of the obstacles of Sec. VII, in metres."""
    centers: list[list[float]] = problem_numbers()["obstacles"]["centers"]
    return centers


def resting_problem(cost: GoalObstacleCost, obstacles: Obstacles | None = None) -> Problem:
    """Returns a problem with this cost whose state, all of it the position, does not move."""
    nx = len(cost.goal)
    system = Linear(jnp.zeros((nx, nx)), jnp.eye(nx), jnp.eye(nx), jnp.zeros((nx, 1)), jnp.ones(nx))
    return Problem(system, cost, jnp.zeros(nx), jnp.ones(nx), dt=1.0, steps=1, obstacles=obstacles)


def position_problem(centers: Sequence[Sequence[float]] | None = None) -> Problem:
    """Returns a problem with the cost of the experiments as a function of the position alone.

    `centers` (M, 2) replaces the obstacles of Sec. VII.
    """
    numbers = bump_cost_numbers()
    weight = jnp.asarray(numbers["running_weight"][:2])
    goal = jnp.asarray(numbers["goal"][:2])
    bump = Bump(numbers["obstacle_penalty"]["width"])
    cost = GoalObstacleCost(goal, weight, weight, weight, numbers["w_obs"], bump)
    radius = problem_numbers()["obstacles"]["radius"]
    centers = obstacle_centers() if centers is None else centers
    return resting_problem(cost, Obstacles(jnp.asarray(centers), radius))


def belief_position() -> np.ndarray:
    """Returns the mean (2,) of the examined belief, beside the first obstacle, in metres."""
    x, y = obstacle_centers()[0]
    return np.array([x, y + BELIEF_DISTANCE])


def belief_beside_obstacle() -> Belief:
    """Returns the belief whose penalty is examined for all theta."""
    return Belief(jnp.asarray(belief_position()), BELIEF_STD**2 * jnp.eye(2))


@partial(jax.jit, static_argnames="risk")
def package_risks(problem: Problem, belief: Belief, risk: str, thetas: Array) -> Array:
    """Returns the package's q_RS (T,), of the penalty alone where `risk` is "penalty"."""
    values = jax.vmap(lambda theta: risk_sensitive(problem, *belief, theta, risk))(thetas)
    return values - running_moments(problem, *belief).base if risk == "penalty" else values


def risk_expansion(
    name: str,
    law: CostLaw,
    problem: Problem,
    belief: Belief,
    risk: str,
    thetas: np.ndarray,
) -> RiskExpansion:
    """Returns the package's q_RS and the exact risk at thetas (T,)."""
    exact = np.array([law.entropic_risk(theta) for theta in thetas])
    expanded = np.asarray(package_risks(problem, belief, risk, jnp.asarray(thetas)))
    return RiskExpansion(name, law, thetas, expanded, exact)


def quadratic_expansion(rng: np.random.Generator) -> RiskExpansion:
    """Returns the expansion for a random quadratic in three dimensions."""
    factors = rng.normal(size=(2, 3, 3))
    mean = rng.normal(size=3)
    goal = rng.normal(size=3)
    W, cov = (0.2 * np.eye(3) + F @ F.T / 3 for F in factors)
    weight = jnp.asarray(W)
    cost = GoalObstacleCost(jnp.asarray(goal), weight, weight, jnp.ones(1))
    problem = resting_problem(cost)
    law = QuadraticLaw(cov @ W, mean - goal, W @ (mean - goal))
    belief = Belief(jnp.asarray(mean), jnp.asarray(cov))
    return risk_expansion(
        "quadratic", law, problem, belief, "total", 0.1 * law.pole * THETA_HALVINGS
    )


def bump_expansions(rng: np.random.Generator) -> list[RiskExpansion]:
    """Returns the expansions for costs with bumps, each under a random belief."""
    centers = obstacle_centers()
    kinds = (
        ("one bump", centers[:1], "penalty"),
        ("two bumps", centers, "penalty"),
        ("whole cost", centers, "total"),
    )
    expansions = []
    for name, bump_centers, risk in kinds:
        belief = _random_belief(rng)
        problem = position_problem(bump_centers)
        law = plane_law(problem, belief, risk, COARSE_STEP)
        _, variance, third = law.cumulants()
        thetas = 0.3 * variance / third * THETA_HALVINGS
        expansions.append(risk_expansion(name, law, problem, belief, risk, thetas))
    return expansions


def _random_belief(rng: np.random.Generator) -> Belief:
    """Returns a belief 0.65 to 1 m from the first obstacle, with random axes and widths."""
    turn, direction = rng.uniform(0, 2 * np.pi, 2)
    distance = rng.uniform(0.65, 1)
    std = rng.uniform(0.2, 0.5, 2)
    axes = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    offset = distance * np.array([np.cos(direction), np.sin(direction)])
    mean = np.array(obstacle_centers()[0]) + offset
    return Belief(jnp.asarray(mean), jnp.asarray(axes @ np.diag(std**2) @ axes.T))
