"""The obstacle penalty of the experiments: q_RS, entropic risk rho, and their bounds (Remark 4).

q_RS = E + theta/2 Var passes the supremum of the penalty at theta = 2 (sup - E) / Var, while rho
never does.
"""

import math

import jax.numpy as jnp
import numpy as np
from scipy.optimize import brentq
from scipy.stats import ncx2

from ...results.certificate import Check
from ..bands import EPSILON, at_least, at_most, near
from .cost_laws import PlaneLaw
from .risk_expansions import (
    BELIEF_STD,
    RiskExpansion,
    belief_beside_obstacle,
    belief_position,
    obstacle_centers,
    package_risks,
    position_problem,
    risk_expansion,
)
from .section_vii import bump_cost_numbers, reference_theta

THETAS = np.geomspace(1e-5, 3.0, 60)  # at which the penalty's risk is examined


def penalty_expansion(law: PlaneLaw) -> RiskExpansion:
    """Returns q_RS and rho of the experiments' penalty at `THETAS`, then at theta of Sec. VII."""
    thetas = np.append(THETAS, reference_theta())
    return risk_expansion(
        "penalty", law, position_problem(), belief_beside_obstacle(), "penalty", thetas
    )


def crossing_checks(penalty: RiskExpansion, law: PlaneLaw) -> list[Check]:
    """Returns checks of the thetas at which the penalty's q_RS crosses its bounds."""
    supremum = penalty_supremum()
    exact = penalty.exact[:-1]
    theta = reference_theta()
    expected, variance, _ = law.cumulants()
    coarse_expected, coarse_variance, _ = law.coarser().cumulants()

    # q_RS = E + theta / 2 Var passes the supremum at 2 (sup - E) / Var.
    limit = 2 * (supremum - expected) / variance
    coarse_limit = 2 * (supremum - coarse_expected) / coarse_variance
    passed = brentq(
        lambda theta: _penalty_risk(theta) - supremum, 0, theta, xtol=EPSILON, rtol=8 * EPSILON
    )
    return [
        near(
            "θ at which q_RS passes the penalty's supremum",
            passed,
            limit,
            abs(limit - coarse_limit) + 1e3 * EPSILON * limit,
            "2 (sup - E) / Var, two sums",
        ),
        at_most(
            "θ from which on q_RS is larger than ρ",
            crossings(law, exact, expected, variance / 2)[-1],
            limit,
            "the θ at which q_RS passes sup ≥ ρ",
        ),
        at_most(
            "least θ where ρ - q_RS is as large as the term θ/2 Var",
            crossings(law, exact, expected, variance)[0],
            theta,
            "θ of Sec. VII",
        ),
    ]


def bound_checks(penalty: RiskExpansion, law: PlaneLaw) -> list[Check]:
    """Returns checks of the values of q_RS and rho for the experiments' penalty.

    The last theta of `penalty` is that of Sec. VII.
    """
    supremum = penalty_supremum()
    expected, *_ = law.cumulants()
    least_step = float(np.min(np.diff(penalty.exact[:-1], prepend=expected)))
    sum_error = max(
        abs(law.coarser().entropic_risk(theta) - law.entropic_risk(theta))
        for theta in (THETAS[0], THETAS[-1])
    )
    return [
        at_least(
            "q_RS at θ = 1",
            float(penalty.expanded[-1]),
            supremum,
            "the penalty's supremum, which bounds ρ",
        ),
        Check(
            "ρ at θ = 1",
            float(penalty.exact[-1]),
            risk_lower_bound(reference_theta()),
            supremum,
            "a lower bound by P(q > s), any s; the supremum",
        ),
        at_least(
            "least of ρ - E and the steps of ρ(θ)",
            least_step,
            sum_error,
            "Jensen, Hölder: positive; error of sums",
        ),
    ]


def penalty_supremum() -> float:
    """Returns the supremum of the penalty: its value at an obstacle's centre."""
    return float(position_problem().penalty(jnp.asarray(obstacle_centers()[0])))


def _penalty_risk(theta: float) -> float:
    """Returns q_RS of the penalty beside the obstacle."""
    thetas = jnp.full(1, theta)
    return float(package_risks(position_problem(), belief_beside_obstacle(), "penalty", thetas)[0])


def crossings(law: PlaneLaw, exact: np.ndarray, expected: float, slope: float) -> list[float]:
    """Returns the thetas at which rho crosses E + slope theta, or NaN if there are none.

    `exact` holds rho at `THETAS`.
    """

    def gap(theta: float) -> float:
        return law.entropic_risk(theta) - expected - slope * theta

    signs = np.sign(exact - expected - slope * THETAS)
    changes = np.flatnonzero(np.diff(signs))
    roots = [float(brentq(gap, THETAS[i], THETAS[i + 1], rtol=1e-6)) for i in changes]
    return roots or [math.nan]


def risk_lower_bound(theta: float) -> float:
    """Returns a lower bound on rho: s + log P(q >= s) / theta.

    q is at least its value on a disc around the obstacle's centre; the result is the best of many
    discs.
    """
    radii = np.geomspace(1e-3, 1, 200)
    square = np.sum((belief_position() - obstacle_centers()[0]) ** 2)
    probability = ncx2.cdf((radii / BELIEF_STD) ** 2, 2, square / BELIEF_STD**2)
    numbers = bump_cost_numbers()
    value = numbers["w_obs"] * np.exp(-(radii**2) / (2 * numbers["obstacle_penalty"]["width"] ** 2))
    return float(np.max(value + np.log(probability) / theta))
