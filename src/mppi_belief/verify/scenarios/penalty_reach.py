"""Computes how far from an obstacle a planner keeps, where a belief is charged a price.

The belief N(mu, sigma^2 I) is at a distance d from a disc of radius r, with the penalty
w max(0, m - distance) of its position, and is charged in one of four ways:

    sigma points   w h(mu) + theta/2 Var by the points mu +- sqrt(c) sigma e_i
    exact moments  w E[h] + theta/2 w^2 Var[h]
    chance         w h(mu), the disc enlarged by k sigma
    quadrature     as with exact moments, by the rule for costs without moments in closed form

The reach is the d at which the charge equals the price P. With the sigma points the nearest one is
inside the margin by h = m + sqrt(c) sigma - d and has the weight a = 1 / (2c), so that beyond the
margin the charge is theta/2 w^2 h^2 a (1 - a): the reach is m + sqrt(c) sigma - O(1/w). It is so
for every rule with finitely many nodes, with the distance of its farthest node. With exact moments
it is m + z sigma, and the tail of the normal distribution gives z. With
E2(z) = int_z^inf (t - z)^2 phi(t) dt,

    theta/2 w^2 sigma^2 E2(z) = P        z < -d log E2 / dz < z + 3/z

so that d(z^2) / d(log w) lies between 4 / (1 + 3/z^2) and 4: z grows without bound. The disc is
curved, which changes E2 by a factor that varies slowly with z.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import i0e
from scipy.stats import norm

from ...belief.cost import expected_terminal, integrated_moments
from ...costs import GoalObstacleCost
from ...costs.penalties import Hinge
from ...numerics.quadrature import cost_rule
from ...obstacles import Obstacles
from ...planning.parts import PathCost
from ...planning.path_costs import ChanceConstrained, RiskSensitive
from ...problem import Problem
from ...structs import choice, number, struct
from .risk_expansions import resting_problem

RADIUS = 0.65  # m, of the disc; Sec. VII
MARGIN = 0.13  # m, of the penalty; our choice
DEVIATION = 0.15  # m, of the belief in each direction; our choice
PRICE = 1.0  # 1/s, at which the reach is taken; the temperature of Sec. VII per second
SPREAD = 4.0  # c of the sigma points; the cubature rule of four states
THETA = 1.0  # risk aversion; Sec. VII
FARTHEST = 4.0  # m, beyond which no reach is looked for
REACH_TOLERANCE = 1e-12  # m, of the root


@struct
class QuadratureRisk:
    """Charges q_RS by the rule for costs without moments in closed form."""

    theta: float = number(ge=0)
    at_step_end: bool = choice(True, False, default=True)

    def running(self, problem: Problem, mean: Array, cov: Array) -> Array:
        """Returns q_RS () for a mean (nx,) and a covariance (nx, nx)."""
        moments = integrated_moments(problem, mean, cov)
        return moments.base + moments.penalty + self.theta / 2 * moments.penalty_var

    def terminal(self, problem: Problem, mean: Array, cov: Array) -> Array:
        """Returns the expected terminal cost () for a mean (nx,) and a covariance (nx, nx)."""
        return expected_terminal(problem, mean, cov)


class Charges(NamedTuple):
    """Holds the ways to charge a belief that the package has."""

    sigma_points: PathCost
    chance: PathCost
    quadrature: PathCost


def charges(theta: float = THETA) -> Charges:
    """Returns the path costs, with sqrt(c) standard deviations for the chance constraint."""
    by_points = RiskSensitive(
        theta, expectation="at_mean", variance="sigma_points", sigma_point_spread=SPREAD
    )
    level = float(norm.sf(math.sqrt(SPREAD)))
    return Charges(by_points, ChanceConstrained(level), QuadratureRisk(theta))


def disc_problem(w_obs: float) -> Problem:
    """Returns a problem of the position alone, with one disc at the origin."""
    free = jnp.zeros(2)
    cost = GoalObstacleCost(
        free, free, free, jnp.ones(2), w_obs=w_obs, obstacle_penalty=Hinge(MARGIN)
    )
    return resting_problem(cost, Obstacles(jnp.zeros((1, 2)), RADIUS))


@jax.jit
def package_charges(problem: Problem, path_cost: PathCost, distances: Array, angle: float) -> Array:
    """Returns what the package charges (n,) per second at distances (n,) from the surface.

    The angle (rad) is that of the belief's direction from the axes of the sigma points.
    """
    direction = jnp.array([jnp.cos(angle), jnp.sin(angle)])
    cov = DEVIATION**2 * jnp.eye(2)
    means = (RADIUS + distances)[:, None] * direction
    return jax.vmap(lambda mean: path_cost.running(problem, mean, cov))(means)


def reach(path_cost: PathCost, w_obs: float, angle: float = 0.0) -> float:
    """Returns the distance (m) at which the package charges the price."""
    problem = disc_problem(w_obs)
    return _root(
        lambda distance: float(package_charges(problem, path_cost, jnp.full(1, distance), angle)[0])
    )


def _root(charged: Callable[[float], float]) -> float:
    """Returns the distance at which a charge that falls with the distance equals the price."""
    root = brentq(lambda d: charged(d) - PRICE, 0.0, FARTHEST, xtol=REACH_TOLERANCE, rtol=1e-14)
    return float(root)


def sigma_point_reach(w_obs: float, theta: float = THETA) -> float:
    """Returns the reach of sigma points in closed form, where it is beyond the margin itself."""
    return limit_distance() - depth_of_node(w_obs, 1 / (2 * SPREAD), theta)


def depth_of_node(w_obs: float, weight: float, theta: float = THETA) -> float:
    """Returns how far (m) one node is inside the margin where its variance costs the price."""
    return math.sqrt(2 * PRICE / (theta * weight * (1 - weight))) / w_obs


def quadrature_bounds(w_obs: float, theta: float = THETA) -> tuple[float, float]:
    """Returns bounds (m) on the reach of the rule for costs without moments in closed form.

    Its farthest node along the axis charges no more than the price where it is at the edge of the
    margin, and no less by its variance alone where it is deep enough.
    """
    points, weights = cost_rule(2)
    farthest = int(np.argmax(points[:, 0]))
    limit = MARGIN + float(points[farthest, 0]) * DEVIATION
    return limit - depth_of_node(w_obs, float(weights[farthest]), theta), limit


def limit_distance() -> float:
    """Returns m + sqrt(c) sigma (m)."""
    return MARGIN + math.sqrt(SPREAD) * DEVIATION


def diagonal_limit() -> float:
    """Returns the limit (m) where the direction of the obstacle halves the angle of the axes.

    Two sigma points are then nearest, at the distance r + m from the disc's centre.
    """
    step = math.sqrt(SPREAD) * DEVIATION
    component = (step + math.sqrt(2 * (RADIUS + MARGIN) ** 2 - step**2)) / 2
    return math.sqrt(2) * component - RADIUS


def exact_reach(w_obs: float, theta: float = THETA) -> float:
    """Returns the reach of exact moments, computed without the package."""
    return _root(lambda distance: exact_charge(w_obs, distance, theta))


def exact_charge(w_obs: float, distance: float, theta: float = THETA) -> float:
    """Returns q_RS with exact moments, per second, at a distance (m) from the surface."""
    first, second = hinge_moments(distance)
    return w_obs * first + theta / 2 * w_obs**2 * (second - first**2)


def hinge_moments(distance: float) -> tuple[float, float]:
    """Returns E[h] (m) and E[h^2] (m^2) of a belief at a distance (m) from the surface.

    The distance of the position from the disc's centre has Rice's distribution.
    """
    center = RADIUS + distance
    edge = RADIUS + MARGIN
    variance = DEVIATION**2

    def density(rho: float) -> float:
        gap = (rho - center) ** 2 / (2 * variance)
        return rho / variance * math.exp(-gap) * float(i0e(rho * center / variance))

    # The integrand has its largest values near the edge or near the mean of the belief.
    peak = min(center, edge - DEVIATION / 4)
    start = max(0.0, peak - 12 * DEVIATION)
    moments = [
        quad(
            lambda rho, power=power: (edge - rho) ** power * density(rho),
            start,
            edge,
            points=[peak],
            epsabs=0,
            epsrel=1e-11,
            limit=200,
        )[0]
        for power in (1, 2)
    ]
    return moments[0], moments[1]


def squared_deviations(reached: np.ndarray) -> np.ndarray:
    """Returns z^2 of reaches: squared distances beyond the margin, in standard deviations."""
    squares: np.ndarray = ((reached - MARGIN) / DEVIATION) ** 2
    return squares
