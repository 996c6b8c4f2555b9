"""Remark 4: its certificate holds, fails for a wrong q_RS, and its laws are right."""

import math
from collections.abc import Callable, Iterator

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax import Array

import mppi_belief as mb
from helpers import float64
from mppi_belief.belief.cost import risk_sensitive, running_moments
from mppi_belief.results.certificate import Certificate, Check
from mppi_belief.verify.certificates import entropic_risk as er
from mppi_belief.verify.scenarios import cost_laws, penalty_risk, risk_expansions
from mppi_belief.verify.scenarios.cost_laws import PlaneLaw, QuadraticLaw, plane_law
from mppi_belief.verify.scenarios.risk_expansions import (
    belief_beside_obstacle,
    position_problem,
    resting_problem,
)
from mppi_belief.verify.scenarios.section_vii import bump_cost_numbers

COARSE_ENOUGH = 0.05


@pytest.fixture(scope="module")
def certificate() -> Certificate:
    with float64():
        return er.certify(0)


@pytest.fixture(scope="module")
def penalty() -> PlaneLaw:
    """Return the law of the penalty beside the obstacle, exact for theta up to about 0.2."""
    with float64():
        return plane_law(position_problem(), belief_beside_obstacle(), "penalty", COARSE_ENOUGH)


@pytest.fixture
def replaced(monkeypatch, x64) -> Iterator[Callable]:
    """Put another q_RS in place of the package's, which is compiled anew."""
    risk_expansions.package_risks.clear_cache()
    yield lambda wrong: monkeypatch.setattr(risk_expansions, "risk_sensitive", wrong)
    risk_expansions.package_risks.clear_cache()


def quadratic_plane(problem: mb.Problem, mean: np.ndarray, cov: np.ndarray) -> PlaneLaw:
    return plane_law(
        problem, mb.Belief(jnp.asarray(mean), jnp.asarray(cov)), "total", COARSE_ENOUGH
    )


def quadratic_case(seed: int) -> tuple[mb.Problem, np.ndarray, np.ndarray, QuadraticLaw]:
    rng = np.random.default_rng(seed)
    F = rng.normal(size=(2, 2))
    S = rng.normal(size=(2, 2))
    mean = rng.normal(size=2)
    goal = rng.normal(size=2)
    W = F @ F.T + 0.1 * np.eye(2)
    cov = 0.3 * S @ S.T + 0.1 * np.eye(2)
    cost = mb.GoalObstacleCost(goal, W, W, [1, 1], w_obs=0, obstacle_penalty=mb.Bump(1))
    problem = resting_problem(cost, mb.Obstacles(np.zeros((1, 2)), 0))
    return problem, mean, cov, QuadraticLaw(cov @ W, mean - goal, W @ (mean - goal))


def test_the_certificate_holds(certificate):
    assert certificate.holds, [check for check in certificate.checks if not check.holds]
    assert 4 <= len(certificate.checks) <= 10
    for panel in certificate.panels:
        for line in panel.lines:
            assert np.all(np.isfinite(line.x))
            assert np.all(np.isfinite(line.y))
            assert len(line.x) == len(line.y) <= 200


def test_a_wrong_weight_of_the_variance_is_seen(replaced):
    def wrong(problem: mb.Problem, mean: Array, cov: Array, theta: Array, risk: str) -> Array:
        return risk_sensitive(problem, mean, cov, 0.999 * theta, risk)

    replaced(wrong)
    case = risk_expansions.quadratic_expansion(np.random.default_rng(0))
    assert not er.order_check(case).holds
    assert not er.coefficient_check(case).holds


def test_a_variance_without_the_covariance_of_its_parts_is_seen(replaced):
    def wrong(problem: mb.Problem, mean: Array, cov: Array, theta: Array, risk: str) -> Array:
        m = running_moments(problem, mean, cov)
        return (
            m.base
            + m.penalty
            + theta / 2 * (m.penalty_var + (m.base_var if risk == "total" else 0))
        )

    replaced(wrong)
    cases = risk_expansions.bump_expansions(np.random.default_rng(0))
    assert [er.order_check(case).holds for case in cases] == [True, True, False]
    assert "whole cost" in er.tightest([er.order_check(case) for case in cases]).computed


def test_the_worst_of_several_costs_is_one_that_fails():
    near = Check("near its end", 0.99, -1.0, 1.0, "")
    for bad in (
        Check("no number", math.nan, -1.0, 1.0, ""),
        Check("no band", 0.0, math.nan, math.nan, ""),
    ):
        for checks in ([bad, near, near], [near, bad, near], [near, near, bad]):
            assert er.tightest(checks).computed.startswith(bad.computed)
            assert not er.tightest(checks).holds
    outside = Check("outside", 1.5, -1.0, 1.0, "")
    assert er.tightest([near, outside]).computed.startswith("outside")
    assert er.tightest([near._replace(value=0.5), near]).value == 0.99


def test_another_third_cumulant_is_seen(x64):
    case = risk_expansions.quadratic_expansion(np.random.default_rng(0))
    skewed = case._replace(law=case.law._replace(offset=1.01 * case.law.offset))
    assert er.coefficient_check(case).holds
    assert not er.coefficient_check(skewed).holds


def test_a_risk_above_the_supremum_or_one_that_falls_is_seen(penalty, x64):
    case = penalty_risk.penalty_expansion(penalty)
    assert penalty_risk.bound_checks(case, penalty)[1].holds
    above = case._replace(exact=np.append(case.exact[:-1], case.expanded[-1]))
    assert not penalty_risk.bound_checks(above, penalty)[1].holds
    falling = case._replace(exact=np.append(case.exact[:-2], case.exact[-3:-1]))
    assert not penalty_risk.bound_checks(falling, penalty)[2].holds
    timid = case._replace(expanded=case.exact)
    assert not penalty_risk.bound_checks(timid, penalty)[0].holds


@pytest.mark.parametrize("seed", range(4))
def test_the_closed_form_of_a_quadratic_is_the_integral(seed, x64):
    problem, mean, cov, law = quadratic_case(seed)
    summed = quadratic_plane(problem, mean, cov)
    np.testing.assert_allclose(summed.cumulants(), law.cumulants(), rtol=1e-9)
    for part in (0.01, 0.1, 0.3):
        assert summed.entropic_risk(part * law.pole) == pytest.approx(
            law.entropic_risk(part * law.pole), rel=1e-9
        )


def test_beyond_its_pole_a_quadratic_has_no_finite_risk(monkeypatch, x64):
    problem, mean, cov, law = quadratic_case(0)
    assert law.entropic_risk(law.pole) == law.entropic_risk(2 * law.pole) == math.inf
    risks = []
    for reach in (5, 10, 20):
        monkeypatch.setattr(cost_laws, "SUM_REACH", reach)
        summed = quadratic_plane(problem, mean, cov)
        risks.append((summed.entropic_risk(0.5 * law.pole), summed.entropic_risk(1.5 * law.pole)))
    below, above = np.array(risks).T
    assert abs(below[2] - below[1]) < 1e-6 * below[1]
    assert np.all(above[1:] > 2 * above[:-1])  # the part of the plane that is summed decides


def test_the_plane_has_the_packages_moments(penalty, x64):
    m = running_moments(position_problem(), *belief_beside_obstacle())
    np.testing.assert_allclose(penalty.cumulants()[:2], [m.penalty, m.penalty_var], rtol=1e-12)
    np.testing.assert_allclose(
        penalty.coarser().cumulants()[:2], [m.penalty, m.penalty_var], rtol=1e-12
    )


@settings(max_examples=40, deadline=None)
@given(st.floats(1e-4, 0.1), st.floats(1.01, 2.0))
def test_the_entropic_risk_is_bounded_and_grows(penalty, theta, factor):
    mean, *_ = penalty.cumulants()
    here = penalty.entropic_risk(theta)
    there = penalty.entropic_risk(factor * theta)
    assert mean < here < there < bump_cost_numbers()["w_obs"]
    assert penalty_risk.risk_lower_bound(theta) <= here


def test_both_ways_of_summing_agree(penalty):
    """Compare both at theta (sup - E) = 30, where the implementation changes."""
    theta = 30 / (np.max(penalty.cost) - penalty.mean(penalty.cost))
    below, above = (penalty.entropic_risk(theta * part) for part in (1 - 1e-9, 1 + 1e-9))
    assert above == pytest.approx(below, rel=1e-8)


def test_no_crossing_is_no_number(penalty):
    assert math.isnan(
        penalty_risk.crossings(penalty, np.zeros(len(penalty_risk.THETAS)), 1.0, 1.0)[0]
    )
