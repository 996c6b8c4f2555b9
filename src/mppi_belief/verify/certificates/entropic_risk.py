"""Remark 4: the risk-sensitive cost against the entropic risk that it expands.

    rho(theta) = 1/theta log E[exp(theta q(x))],   q_RS = E[q] + theta/2 Var[q],   x ~ N(mu, Sigma)
    rho - q_RS = theta^2/6 kappa_3 + theta^3/24 kappa_4 + ...        kappa_n the cumulants of q(x)

For q = 1/2 (x - r)' W (x - r), M = Sigma W, d = mu - r:

    theta rho = -1/2 log det(I - theta M) + theta/2 d' W (I - theta M)^-1 d,   infinite from theta lambda_max(M) = 1 on
    kappa_3   = tr M^3 + 3 d' W M^2 d

For costs with bumps, expectations are trapezoidal sums in the plane, which converge faster than any power of the
step for what is smooth and decays like a Gaussian; the sum over every other point says how far off they are.
"""

import math
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.optimize import brentq
from scipy.stats import ncx2

from ...belief.cost import risk_sensitive, running_moments
from ...costs import GoalObstacleCost
from ...obstacles import Obstacles
from ...problem import Belief, Problem
from ...results.certificate import Certificate, Check, Line, Panel
from ...systems import Linear
from ..bands import EPSILON, at_least, at_most, near, order

# Sec. VII and the calibrated weights of the experiments; positions alone, on which the penalty depends
CENTERS, RADIUS, W_OBS, WIDTH, GOAL, WEIGHT = (
    ((3.0, 1.0), (3.0, -1.0)),
    0.65,
    300.0,
    0.26,
    (7.0, 0.0),
    1.0,
)
PLACE, SPREAD, THETA = (
    (3.0, 1.8),
    0.35,
    1.0,
)  # a belief beside an obstacle, m, and theta of Sec. VII
HALVED = 2.0 ** -np.arange(6)
REACH, FINE, COARSE = (
    9.5,
    0.0125,
    0.1,
)  # of the sums, in standard deviations; the fine one resolves theta w_obs = 900
THETAS = np.geomspace(1e-5, 3.0, 60)


class Plane(NamedTuple):
    """A trapezoidal sum: costs (n, n) at points of the plane and their weights (n, n)."""

    cost: np.ndarray
    weight: np.ndarray

    def mean(self, values: np.ndarray) -> float:
        """E of values (n, n)."""
        return float(np.sum(self.weight * values))

    def coarser(self) -> "Plane":
        """Every other point."""
        return Plane(self.cost[::2, ::2], 4 * self.weight[::2, ::2])

    def cumulants(self) -> tuple[float, float, float]:
        """The first three."""
        mean = self.mean(self.cost)
        away = self.cost - mean
        return mean, self.mean(away**2), self.mean(away**3)

    def entropic_risk(self, theta: float) -> float:
        """rho(theta)."""
        largest, mean = float(np.max(self.cost)), self.mean(self.cost)
        if (
            theta * (largest - mean) > 30
        ):  # where exp would soon overflow, E exp - 1 no longer cancels
            return largest + math.log(self.mean(np.exp(theta * (self.cost - largest)))) / theta
        return mean + math.log1p(self.mean(np.expm1(theta * (self.cost - mean)))) / theta


class Quadratic(NamedTuple):
    """1/2 (x - r)' W (x - r) under N(mu, Sigma): M = Sigma W (n, n), d = mu - r (n,) and W d (n,)."""

    spread: np.ndarray
    offset: np.ndarray
    slope: np.ndarray

    @property
    def pole(self) -> float:
        """The theta from which on rho is infinite."""
        return float(1 / np.max(np.linalg.eigvals(self.spread).real))

    def cumulants(self) -> tuple[float, float, float]:
        """The first three."""
        M, d, Wd = self.spread, self.offset, self.slope
        mean, variance = 0.5 * (np.trace(M) + d @ Wd), 0.5 * np.trace(M @ M) + Wd @ M @ d
        return float(mean), float(variance), float(np.trace(M @ M @ M) + 3 * Wd @ M @ M @ d)

    def entropic_risk(self, theta: float) -> float:
        """rho(theta)."""
        if theta >= self.pole:
            return math.inf
        kept = np.eye(len(self.offset)) - theta * self.spread
        return float(
            -0.5 * np.linalg.slogdet(kept)[1] / theta
            + 0.5 * self.slope @ np.linalg.solve(kept, self.offset)
        )


class Expansion(NamedTuple):
    """A cost under a belief: its law; q_RS and rho (T,) at thetas (T,)."""

    name: str
    law: Plane | Quadratic
    thetas: np.ndarray
    expanded: np.ndarray
    exact: np.ndarray

    @property
    def errors(self) -> np.ndarray:
        """rho - q_RS (T,)."""
        return self.exact - self.expanded


def charged(cost: GoalObstacleCost, obstacles: Obstacles | None = None) -> Problem:
    """Return a problem with this cost whose state, all of it the position, stays where it is."""
    nx = len(cost.goal)
    system = Linear(jnp.zeros((nx, nx)), jnp.eye(nx), jnp.eye(nx), jnp.zeros((nx, 1)), jnp.ones(nx))
    return Problem(system, cost, jnp.zeros(nx), jnp.ones(nx), dt=1.0, steps=1, obstacles=obstacles)


def goal_problem(centers: Sequence[Sequence[float]] = CENTERS) -> Problem:
    """Return a problem with the cost of the experiments, of the position alone."""
    weight = jnp.full(2, WEIGHT)
    cost = GoalObstacleCost(jnp.asarray(GOAL), weight, weight, weight, W_OBS, WIDTH)
    return charged(cost, Obstacles(jnp.asarray(centers), RADIUS))


def beside() -> Belief:
    """The belief whose penalty is looked at for all theta."""
    return Belief(jnp.asarray(PLACE), SPREAD**2 * jnp.eye(2))


@jax.jit
def _values(problem: Problem, points: Array) -> tuple[Array, Array]:
    return jax.vmap(problem.cost.base)(points), jax.vmap(problem.penalty)(points)


def plane(problem: Problem, belief: Belief, risk: str, step: float) -> Plane:
    """The law of the penalty (`risk` "penalty") or of the whole running cost ("total") of a position."""
    z = step * np.arange(-round(REACH / step), round(REACH / step) + 1)
    whitened = np.stack(np.meshgrid(z, z, indexing="ij"), axis=-1)
    points = np.asarray(belief.mean) + whitened.reshape(-1, 2) @ np.linalg.cholesky(belief.cov).T
    base, penalty = (
        np.asarray(v).reshape(len(z), len(z)) for v in _values(problem, jnp.asarray(points))
    )
    density = step / math.sqrt(2 * math.pi) * np.exp(-(z**2) / 2)
    return Plane(penalty if risk == "penalty" else base + penalty, np.outer(density, density))


@partial(jax.jit, static_argnames="risk")
def _risks(problem: Problem, belief: Belief, risk: str, thetas: Array) -> Array:
    """The package's q_RS (T,), of the penalty alone where `risk` is "penalty"."""
    values = jax.vmap(lambda theta: risk_sensitive(problem, *belief, theta, risk))(thetas)
    return values - running_moments(problem, *belief).base if risk == "penalty" else values


def expansion(
    name: str,
    law: Plane | Quadratic,
    problem: Problem,
    belief: Belief,
    risk: str,
    thetas: np.ndarray,
) -> Expansion:
    """The package's q_RS beside the exact risk at thetas (T,)."""
    exact = np.array([law.entropic_risk(theta) for theta in thetas])
    return Expansion(
        name, law, thetas, np.asarray(_risks(problem, belief, risk, jnp.asarray(thetas))), exact
    )


def quadratic_expansion(rng: np.random.Generator) -> Expansion:
    """A quadratic in three dimensions, all drawn."""
    factors, mean, goal = rng.normal(size=(2, 3, 3)), rng.normal(size=3), rng.normal(size=3)
    W, cov = (0.2 * np.eye(3) + F @ F.T / 3 for F in factors)
    weight = jnp.asarray(W)
    problem = charged(GoalObstacleCost(jnp.asarray(goal), weight, weight, jnp.ones(1)))
    law = Quadratic(cov @ W, mean - goal, W @ (mean - goal))
    belief = Belief(jnp.asarray(mean), jnp.asarray(cov))
    return expansion("quadratic", law, problem, belief, "total", 0.1 * law.pole * HALVED)


def bump_expansions(rng: np.random.Generator) -> list[Expansion]:
    """Costs with bumps, each under a belief drawn from beside an obstacle."""
    kinds = (
        ("one bump", CENTERS[:1], "penalty"),
        ("two bumps", CENTERS, "penalty"),
        ("whole cost", CENTERS, "total"),
    )
    found = []
    for name, centers, risk in kinds:
        (turn, way), distance, std = (
            rng.uniform(0, 2 * np.pi, 2),
            rng.uniform(0.65, 1),
            rng.uniform(0.2, 0.5, 2),
        )
        axes = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        mean = np.array(CENTERS[0]) + distance * np.array([np.cos(way), np.sin(way)])
        cost, belief = (
            goal_problem(centers),
            Belief(jnp.asarray(mean), jnp.asarray(axes @ np.diag(std**2) @ axes.T)),
        )
        law = plane(cost, belief, risk, COARSE)
        _, variance, third = law.cumulants()
        found.append(expansion(name, law, cost, belief, risk, 0.3 * variance / third * HALVED))
    return found


def certify(seed: int = 0) -> Certificate:
    """Order and coefficient of what q_RS leaves out, and how far the expansion reaches for the experiments' penalty."""
    rng = np.random.default_rng(seed)
    quadratic, bumps = quadratic_expansion(rng), bump_expansions(rng)
    law = plane(goal_problem(), beside(), "penalty", FINE)
    penalty = expansion(
        "penalty", law, goal_problem(), beside(), "penalty", np.append(THETAS, THETA)
    )
    checks = [
        _order(quadratic),
        _coefficient(quadratic),
        _tightest([_order(case) for case in bumps]),
        _tightest([_coefficient(case) for case in bumps]),
        *_reach_checks(penalty, law),
    ]
    text = (
        "The package's q_RS agrees with the entropic risk ρ to second order in θ, for quadratic costs and Gaussian "
        f"bumps. For θ = 1 of Sec. VII, our calibrated w_obs = {W_OBS:.0f} and bump width {WIDTH} m, and a belief of"
        f" our choice (0.8 m off an obstacle's centre, standard deviation {SPREAD} m), the penalty has E = "
        f"{law.cumulants()[0]:.3g}, ρ = {penalty.exact[-1]:.3g} and q_RS = {penalty.expanded[-1]:.4g}, and is nowhere "
        f"larger than {W_OBS:.0f}: θ w_obs is far outside the range of the expansion. What acts in our experiments, "
        "with these calibrated numbers, is a penalty on the variance of the cost, not the entropic risk, here nearly "
        "the worst case. For quadratic costs ρ is infinite from θ λ_max(Σ W) = 1 on, where q_RS is still finite."
    )
    panels = [
        _quadratic_panel(quadratic),
        _penalty_panel(penalty, law),
        _error_panel([quadratic, *bumps]),
    ]
    return Certificate("entropic_risk", "Remark 4, risk-sensitive cost", text, checks, panels)


def _order(case: Expansion) -> Check:
    return order(f"order in θ of ρ - q_RS, {case.name}", 2, [float(e) for e in case.errors])


def _coefficient(case: Expansion) -> Check:
    """lim (rho - q_RS) / theta^2, two terms of its expansion taken off."""
    ratios, (*_, third) = case.errors / case.thetas**2, case.law.cumulants()
    once = 2 * ratios[1:] - ratios[:-1]
    twice = (4 * once[1:] - once[:-1]) / 3
    # two corrections: either term may happen to be nothing
    tolerance = 6 * (abs(twice[-1] - once[-1]) + abs(twice[-1] - twice[-2])) / abs(third)
    computed = f"(ρ - q_RS) / θ² for θ → 0 over κ₃/6, {case.name}"
    return near(
        computed, 6 * twice[-1] / third, 1.0, tolerance, "the last two Richardson corrections"
    )


def _tightest(checks: Sequence[Check]) -> Check:
    """Of several two-sided checks one that fails, or else the one that is nearest to failing."""
    worst = max(
        checks,
        key=lambda c: abs(2 * c.value - c.low - c.high) / (c.high - c.low) if c.holds else math.inf,
    )
    return worst._replace(computed=f"{worst.computed}: the worst of {len(checks)} costs")


def _reach_checks(penalty: Expansion, law: Plane) -> list[Check]:
    """What q_RS and rho are for the experiments' penalty, the last theta being that of Sec. VII."""
    top, exact = float(goal_problem().penalty(jnp.asarray(CENTERS[0]))), penalty.exact[:-1]
    (expected, variance, _), (mean, again, _) = law.cumulants(), law.coarser().cumulants()
    limit, apart = 2 * (top - expected) / variance, 2 * (top - mean) / again
    passed = brentq(lambda theta: _expanded(theta) - top, 0, THETA, xtol=EPSILON, rtol=8 * EPSILON)
    tolerance = abs(limit - apart) + 1e3 * EPSILON * limit
    least = float(np.min(np.diff(exact, prepend=expected)))
    inexact = max(
        abs(law.coarser().entropic_risk(t) - law.entropic_risk(t)) for t in (THETAS[0], THETAS[-1])
    )
    above, valid = (
        _crossings(law, exact, expected, variance / 2)[-1],
        _crossings(law, exact, expected, variance)[0],
    )
    bound = "a lower bound by P(q > s), any s; the supremum"
    return [
        near(
            "θ at which q_RS passes the penalty's supremum",
            passed,
            limit,
            tolerance,
            "2 (sup - E) / Var, two sums",
        ),
        at_most(
            "θ from which on q_RS is larger than ρ",
            above,
            limit,
            "the θ at which q_RS passes sup ≥ ρ",
        ),
        at_most(
            "least θ where ρ - q_RS is as large as the term θ/2 Var", valid, THETA, "θ of Sec. VII"
        ),
        at_least(
            "q_RS at θ = 1",
            float(penalty.expanded[-1]),
            top,
            "the penalty's supremum, which bounds ρ",
        ),
        Check("ρ at θ = 1", float(penalty.exact[-1]), _lower_bound(THETA), top, bound),
        at_least(
            "least of ρ - E and the steps of ρ(θ)",
            least,
            inexact,
            "Jensen, Hölder: positive; error of sums",
        ),
    ]


def _expanded(theta: float) -> float:
    """q_RS of the penalty beside the obstacle."""
    return float(_risks(goal_problem(), beside(), "penalty", jnp.full(1, theta))[0])


def _crossings(law: Plane, exact: np.ndarray, expected: float, slope: float) -> list[float]:
    """Where rho, `exact` at `THETAS`, crosses E + slope theta; not a number if nowhere."""

    def gap(theta: float) -> float:
        return law.entropic_risk(theta) - expected - slope * theta

    turns = np.flatnonzero(np.diff(np.sign(exact - expected - slope * THETAS)))
    return [float(brentq(gap, THETAS[i], THETAS[i + 1], rtol=1e-6)) for i in turns] or [math.nan]


def _lower_bound(theta: float) -> float:
    """rho >= s + log P(q >= s) / theta, q at least its value on a disc about the centre; the best of many discs."""
    radii = np.geomspace(1e-3, 1, 200)
    inside = ncx2.cdf(
        (radii / SPREAD) ** 2, 2, np.sum((np.array(PLACE) - CENTERS[0]) ** 2) / SPREAD**2
    )
    return float(np.max(W_OBS * np.exp(-(radii**2) / (2 * WIDTH**2)) + np.log(inside) / theta))


def _quadratic_panel(case: Expansion) -> Panel:
    law, (mean, variance, _) = case.law, case.law.cumulants()
    thetas = (
        10
        * case.thetas[0]
        * np.append(np.geomspace(1e-3, 0.3, 60), 1 - np.geomspace(0.7, 0.02, 40)[1:])
    )
    lines = [
        Line("entropic risk ρ", list(thetas), [law.entropic_risk(theta) for theta in thetas]),
        Line("q_RS", list(thetas), list(mean + thetas / 2 * variance)),
        Line("E[q]", list(thetas[[0, -1]]), [mean, mean], "dashed"),
    ]
    return Panel("A quadratic cost: ρ has a pole", "risk aversion θ (1/cost)", "cost", lines, "x")


def _penalty_panel(penalty: Expansion, law: Plane) -> Panel:
    thetas, ends, mean = list(THETAS), [THETAS[0], THETAS[-1]], law.cumulants()[0]
    lines = [
        Line("entropic risk ρ", thetas, list(penalty.exact[:-1])),
        Line("q_RS", thetas, list(penalty.expanded[:-1])),
        Line("E[q]", ends, [mean, mean], "dashed"),
        Line("supremum of the penalty", ends, [W_OBS, W_OBS], "dashed"),
    ]
    return Panel(
        "The obstacle penalty of the experiments",
        "risk aversion θ (s)",
        "penalty (1/s)",
        lines,
        "xy",
    )


def _error_panel(cases: Sequence[Expansion]) -> Panel:
    """In units of the cost's standard deviation; the coefficient is then a sixth of its skewness."""
    deviations = [math.sqrt(case.law.cumulants()[1]) for case in cases]
    lines = [
        Line(c.name, list(c.thetas * s), list(c.errors / s), "points")
        for c, s in zip(cases, deviations, strict=True)
    ]
    ends, x, y = np.array([0.02, 1.0]), lines[0].x[0], lines[0].y[0]
    lines.append(Line("order 2", list(ends * x), list(ends**2 * y), "dashed"))
    return Panel(
        "What q_RS leaves out",
        "risk aversion θ (1 / std[q])",
        "what is left out, ρ - q_RS (std[q])",
        lines,
        "xy",
    )
