"""Remark 4: the risk-sensitive cost q_RS against the entropic risk rho that it expands.

    rho(theta) = 1/theta log E[exp(theta q(x))],   q_RS = E[q] + theta/2 Var[q],   x ~ N(mu, Sigma)
    rho - q_RS = theta^2/6 kappa_3 + theta^3/24 kappa_4 + ...

kappa_n are the cumulants of q(x). `scenarios.penalty_risk` examines how far the expansion holds for
the obstacle penalty of the experiments.
"""

import math
from collections.abc import Sequence

import numpy as np

from ...results.certificate import Certificate, Check, Line, Panel
from ..bands import near, order
from ..scenarios.cost_laws import PlaneLaw, plane_law
from ..scenarios.penalty_risk import THETAS, bound_checks, crossing_checks, penalty_expansion
from ..scenarios.risk_expansions import (
    BELIEF_DISTANCE,
    BELIEF_STD,
    FINE_STEP,
    RiskExpansion,
    belief_beside_obstacle,
    bump_expansions,
    position_problem,
    quadratic_expansion,
)
from ..scenarios.section_vii import bump_cost_numbers, reference_theta


def certify(seed: int = 0) -> Certificate:
    """Returns the certificate: what q_RS omits, and how far the penalty's expansion holds."""
    rng = np.random.default_rng(seed)
    quadratic = quadratic_expansion(rng)
    bumps = bump_expansions(rng)
    law = plane_law(position_problem(), belief_beside_obstacle(), "penalty", FINE_STEP)
    penalty = penalty_expansion(law)
    checks = [
        order_check(quadratic),
        coefficient_check(quadratic),
        tightest([order_check(case) for case in bumps]),
        tightest([coefficient_check(case) for case in bumps]),
        *crossing_checks(penalty, law),
        *bound_checks(penalty, law),
    ]
    panels = [
        _quadratic_panel(quadratic),
        _penalty_panel(penalty, law),
        _error_panel([quadratic, *bumps]),
    ]
    return Certificate(
        "entropic_risk", "Remark 4, risk-sensitive cost", _risk_text(penalty, law), checks, panels
    )


def _risk_text(penalty: RiskExpansion, law: PlaneLaw) -> str:
    w_obs = bump_cost_numbers()["w_obs"]
    width = bump_cost_numbers()["obstacle_penalty"]["width"]
    expected, *_ = law.cumulants()
    return (
        "The package's q_RS agrees with the entropic risk ρ to second order in θ, for quadratic "
        f"costs and Gaussian bumps. For θ = {reference_theta():g} of Sec. VII, w_obs = {w_obs:.0f} "
        f"and width {width} m as calibrated for bumps (table_1_bumps), and a belief of our choice "
        f"({BELIEF_DISTANCE} m from an obstacle's centre, standard deviation {BELIEF_STD} m), the "
        f"penalty has E = {expected:.3g}, ρ = {penalty.exact[-1]:.3g} and q_RS = "
        f"{penalty.expanded[-1]:.4g}, and is nowhere larger than {w_obs:.0f}: θ w_obs is far "
        "outside the range of the expansion. In experiments with these numbers "
        "q_RS acts as a penalty on the variance of the cost, not as the entropic risk, which is "
        "here nearly the worst case. For quadratic costs ρ is infinite from θ λ_max(Σ W) = 1 on, "
        "where q_RS is still finite."
    )


def order_check(case: RiskExpansion) -> Check:
    """Returns the check that rho - q_RS is of second order in theta."""
    errors = [float(error) for error in case.errors]
    return order(f"order in θ of ρ - q_RS, {case.name}", 2, errors)


def coefficient_check(case: RiskExpansion) -> Check:
    """Returns the check of lim (rho - q_RS) / theta^2, by extrapolation over two terms."""
    ratios = case.errors / case.thetas**2
    *_, third = case.law.cumulants()
    once = 2 * ratios[1:] - ratios[:-1]
    twice = (4 * once[1:] - once[:-1]) / 3
    # Two corrections, since either term may happen to vanish.
    corrections = abs(twice[-1] - once[-1]) + abs(twice[-1] - twice[-2])
    return near(
        f"(ρ - q_RS) / θ² for θ → 0 over κ₃/6, {case.name}",
        6 * twice[-1] / third,
        1.0,
        6 * corrections / abs(third),
        "the last two Richardson corrections",
    )


def tightest(checks: Sequence[Check]) -> Check:
    """Returns a failing one of several two-sided checks, or else the one nearest to failing."""

    def strain(check: Check) -> float:
        if not check.holds:
            return math.inf
        return abs(2 * check.value - check.low - check.high) / (check.high - check.low)

    worst = max(checks, key=strain)
    return worst._replace(computed=f"{worst.computed}: the worst of {len(checks)} costs")


def _quadratic_panel(case: RiskExpansion) -> Panel:
    mean, variance, _ = case.law.cumulants()
    up_to_a_third = np.geomspace(1e-3, 0.3, 60)
    up_to_the_pole = 1 - np.geomspace(0.7, 0.02, 40)[1:]
    thetas = 10 * case.thetas[0] * np.append(up_to_a_third, up_to_the_pole)
    risks = [case.law.entropic_risk(theta) for theta in thetas]
    lines = [
        Line("entropic risk ρ", list(thetas), risks),
        Line("q_RS", list(thetas), list(mean + thetas / 2 * variance)),
        Line("E[q]", list(thetas[[0, -1]]), [mean, mean], "dashed"),
    ]
    return Panel("A quadratic cost: ρ has a pole", "risk aversion θ (1/cost)", "cost", lines, "x")


def _penalty_panel(penalty: RiskExpansion, law: PlaneLaw) -> Panel:
    thetas = list(THETAS)
    ends = [THETAS[0], THETAS[-1]]
    expected, *_ = law.cumulants()
    w_obs = bump_cost_numbers()["w_obs"]
    return Panel(
        "The obstacle penalty of the experiments",
        "risk aversion θ (s)",
        "penalty (1/s)",
        [
            Line("entropic risk ρ", thetas, list(penalty.exact[:-1])),
            Line("q_RS", thetas, list(penalty.expanded[:-1])),
            Line("E[q]", ends, [expected, expected], "dashed"),
            Line("supremum of the penalty", ends, [w_obs, w_obs], "dashed"),
        ],
        "xy",
    )


def _error_panel(cases: Sequence[RiskExpansion]) -> Panel:
    """Returns errors in units of the cost's standard deviation.

    The coefficient is then a sixth of the cost's skewness.
    """
    lines = []
    for case in cases:
        _, variance, _ = case.law.cumulants()
        deviation = math.sqrt(variance)
        x = list(case.thetas * deviation)
        lines.append(Line(case.name, x, list(case.errors / deviation), "points"))
    span = np.array([0.02, 1.0])
    first = lines[0]
    lines.append(Line("order 2", list(span * first.x[0]), list(span**2 * first.y[0]), "dashed"))
    return Panel(
        "What q_RS omits",
        "risk aversion θ (1 / std[q])",
        "ρ - q_RS (std[q])",
        lines,
        "xy",
    )
