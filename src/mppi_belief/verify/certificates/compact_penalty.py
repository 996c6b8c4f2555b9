"""Remark 4 with a penalty of compact support: the variance by sigma points is a margin.

`scenarios.penalty_reach` derives the distance from an obstacle at which a belief is charged a
price, for sigma points, exact moments and a chance constraint, as the obstacle weight grows.
"""

import jax.numpy as jnp
import numpy as np

from ...results.certificate import Certificate, Check, Line, Panel
from ..bands import EPSILON, at_least, at_most, near, observed_orders
from ..scenarios.penalty_reach import (
    DEVIATION,
    MARGIN,
    PRICE,
    REACH_TOLERANCE,
    charges,
    diagonal_limit,
    disc_problem,
    exact_charge,
    exact_reach,
    limit_distance,
    package_charges,
    quadrature_bounds,
    reach,
    sigma_point_reach,
    squared_deviations,
)

WEIGHTS = 10.0 ** np.arange(2, 7)  # 1/s, four decades
LARGE_WEIGHTS = 10.0 ** np.arange(8, 11)  # 1/s, for the growth of the tail
THETAS = (0.01, 0.1, 1.0, 10.0, 100.0)
DIAGONAL = np.pi / 4  # rad
COMPACT_TEXT = (
    f"A belief with a standard deviation of {DEVIATION} m in each direction lies beside a disc "
    f"whose penalty is w max(0, m - distance), m = {MARGIN} m. Examined is the distance at which "
    f"it is charged {PRICE:g}/s. With the penalty at the mean and its variance by sigma points "
    "mu ± √c σ this distance tends to m + √c σ for w → ∞, at order 1 in 1/w, whatever θ is; it is "
    "the distance that an explicit chance constraint with k = √c standard deviations has. With "
    "exact moments it is m + zσ, and z² grows by almost 4 per unit of log w (and by 2 per unit of "
    "log θ), without bound. So a sigma-point variance of a compact penalty is a margin of √c "
    "standard deviations in disguise, and neither θ nor w matters to it. The margin is that in the "
    "direction of a sigma point; between two of them it is smaller, by a factor of √2 for a wall. "
    "The same holds for every rule with finitely many nodes, as for the package's own rule for "
    "costs without moments in closed form: its farthest node is 3σ away."
)


def certify(seed: int = 0) -> Certificate:
    """Returns the certificate; nothing in it is random."""
    return Certificate(
        "compact_penalty",
        "Remark 4, a penalty of compact support",
        COMPACT_TEXT,
        [*sigma_point_checks(), *margin_checks(), *exact_checks()],
        [_charge_panel(), _reach_panel()],
    )


def sigma_point_checks() -> list[Check]:
    """Returns checks that sigma points keep m + sqrt(c) sigma, for every theta and weight."""
    by_points = charges().sigma_points
    reached = np.array([reach(by_points, w) for w in WEIGHTS])
    closed = np.array([sigma_point_reach(w) for w in WEIGHTS])
    limit = limit_distance()
    over_theta = [reach(charges(theta).sigma_points, w) for theta in THETAS for w in WEIGHTS]
    last = WEIGHTS[-1]
    diagonal = reach(by_points, last, DIAGONAL)
    return [
        near(
            "sigma points: distance less its closed form, m; the largest of four decades of w",
            float(np.max(np.abs(reached - closed))),
            0.0,
            REACH_TOLERANCE + 100 * EPSILON,
            "tolerance of the root",
        ),
        near(
            "sigma points: order in 1/w of m + √c σ less the distance, w from 10⁵ to 10⁶",
            float(observed_orders(list(limit - reached), 10.0)[-1]),
            1.0,
            2 * REACH_TOLERANCE / float(limit - reached[-1]),
            "tolerance of the roots",
        ),
        at_most(
            "sigma points: largest distance over five decades of θ and w, m",
            max(over_theta),
            limit,
            "m + √c σ",
        ),
        near(
            "sigma points: distance between two axes, w = 10⁶, m",
            diagonal,
            diagonal_limit(),
            2 * (limit - sigma_point_reach(last)),
            "its limit for w → ∞; twice the remainder along an axis",
        ),
    ]


def margin_checks() -> list[Check]:
    """Returns checks of what else is a margin: a chance constraint, and any rule with nodes."""
    reached = [reach(charges().chance, w) for w in WEIGHTS]
    closed = [limit_distance() - PRICE / w for w in WEIGHTS]
    gap = float(np.max(np.abs(np.subtract(reached, closed))))
    last = WEIGHTS[-1]
    return [
        near(
            "chance constraint, k = √c: distance less m + √c σ - P/w, m; the largest",
            gap,
            0.0,
            REACH_TOLERANCE + 1e3 * EPSILON,
            "tolerance of the root; rounding of the quantile",
        ),
        Check(
            "rule for costs without closed forms: distance, w = 10⁶, m",
            reach(charges().quadrature, last),
            *quadrature_bounds(last),
            "its farthest node at 3σ, and the depth at which that costs P",
        ),
    ]


def exact_checks() -> list[Check]:
    """Returns checks of the distance that exact moments keep, integrated without the package."""
    squares = squared_deviations(np.array([exact_reach(w) for w in LARGE_WEIGHTS]))
    growth = np.diff(squares) / np.diff(np.log(LARGE_WEIGHTS))
    return [
        at_least(
            "exact moments: distance at w = 10⁶ less that at w = 10², m",
            exact_reach(WEIGHTS[-1]) - exact_reach(WEIGHTS[0]),
            limit_distance() - sigma_point_reach(WEIGHTS[0]),
            "what sigma points gain for w from 10² to ∞",
        ),
        Check(
            "exact moments: d(z²) / d(log w), w from 10⁹ to 10¹⁰",
            float(growth[-1]),
            4 / (1 + 4 / squares[-2]),
            4.0,
            "tail of the normal distribution: 4 / (1 + 4/z²) and 4",
        ),
    ]


def _charge_panel() -> Panel:
    """Returns the charge over the distance, at two weights."""
    distances = np.linspace(0.0, 1.2, 61)
    by_points = charges().sigma_points
    lines = []
    for w in (WEIGHTS[0], WEIGHTS[2]):
        by_package = package_charges(disc_problem(w), by_points, jnp.asarray(distances), 0.0)
        exact = np.array([exact_charge(w, distance) for distance in distances])
        for name, values in (("sigma points", np.asarray(by_package)), ("exact moments", exact)):
            shown = values > PRICE / 1e3
            x = list(distances[shown])
            lines.append(Line(f"{name}, w = {w:.0f}", x, list(values[shown])))
    ends = [float(distances[0]), float(distances[-1])]
    lines.append(Line("price", ends, [PRICE, PRICE], "dashed"))
    return Panel("What a belief is charged", "distance (m)", "charge (1/s)", lines, "y")


def _reach_panel() -> Panel:
    """Returns the distance that each charge keeps, over the weight."""
    weights = list(WEIGHTS)
    by_points, chance, quadrature = charges()
    lines = [
        Line("exact moments", weights, [exact_reach(w) for w in weights]),
        Line("rule of 37 nodes", weights, [reach(quadrature, w) for w in weights]),
        Line("sigma points", weights, [reach(by_points, w) for w in weights]),
        Line("chance constraint", weights, [reach(chance, w) for w in weights], "points"),
        Line("m + √c σ", [weights[0], weights[-1]], [limit_distance()] * 2, "dashed"),
    ]
    return Panel("Where it is charged 1/s", "obstacle weight w (1/s)", "distance (m)", lines, "x")
