"""Theorem 4's certificate: it holds, and it fails where the theorem or the package would."""

from collections.abc import Iterator

import numpy as np
import pytest

from helpers import float64
from mppi_belief.results.certificate import Certificate
from mppi_belief.verify.certificates import cole_hopf
from mppi_belief.verify.estimates import rms
from mppi_belief.verify.scenarios.matched_scalar import (
    MatchedProblem,
    SteadySchedule,
    matched_problem,
    scalar_equation,
    steady_schedule,
)
from mppi_belief.verify.solvers import grid_solutions
from mppi_belief.verify.solvers.bellman_residual import (
    REFINEMENTS,
    solve_both,
    unmatched_residual,
)
from mppi_belief.verify.solvers.scalar_equations import MeanGrid, ScalarEquation, quadratic


@pytest.fixture(scope="module")
def certificate() -> Iterator[Certificate]:
    with float64():
        yield cole_hopf.certify()


@pytest.fixture(scope="module")
def setting() -> Iterator[tuple[MatchedProblem, SteadySchedule, ScalarEquation]]:
    with float64():
        matched = matched_problem()
        schedule = steady_schedule(matched.problem, matched.cov)
        yield matched, schedule, scalar_equation(matched, schedule)


def failed(certificate: Certificate) -> str:
    return "\n".join(check.computed for check in certificate.checks if not check.holds)


def test_the_certificate_holds(certificate):
    assert certificate.holds, failed(certificate)
    assert len(certificate.panels) == 3


def test_a_wrong_sign_in_front_of_the_gradient_term_shows(monkeypatch, x64):
    value = grid_solutions.solve_value

    def wrong(terms: ScalarEquation, grid: MeanGrid) -> tuple[np.ndarray, float]:
        return value(terms._replace(authority=0.9 * terms.authority), grid)

    monkeypatch.setattr(grid_solutions, "solve_value", wrong)
    broken = cole_hopf.certify()
    assert "V by (13), method of lines: order" in failed(broken)
    assert "V by (13) from the Riccati solution" in failed(broken)


def test_a_transform_of_another_temperature_shows(monkeypatch, x64):
    desirability = grid_solutions.solve_desirability
    monkeypatch.setattr(
        grid_solutions,
        "solve_desirability",
        lambda terms, grid: np.abs(desirability(terms, grid)) ** 1.01,
    )
    broken = failed(cole_hopf.certify())
    for part in (
        "RMS residual of (14)",
        "V by (16) from V by",
        "V by (16) from the Riccati",
        "slope",
        "prediction",
    ):
        assert part in broken


def test_a_covariance_off_its_steady_state_shows(setting):
    matched, _, _ = setting
    with float64():
        unsteady = steady_schedule(matched.problem, 1.001 * matched.cov)
        assert not cole_hopf.schedule_check(matched, unsteady).holds


def test_another_control_weight_shows_in_the_minimum(setting):
    matched, _, terms = setting
    with float64():
        solution = solve_both(terms, 280, 20)
        assert all(check.holds for check in cole_hopf.minimum_checks(matched, terms, solution))
        heavier = matched_problem(temperature=1.001 * matched.temperature)
        assert not all(check.holds for check in cole_hopf.minimum_checks(heavier, terms, solution))


def test_what_is_drawn_without_matching_is_the_prediction(certificate):
    computed, predicted = certificate.panels[-1].lines
    assert predicted.y[predicted.x.index(1.0)] == 0.0
    between = np.interp(computed.x, predicted.x, predicted.y)
    np.testing.assert_allclose(computed.y, between, atol=0.02 * max(predicted.y))


@pytest.mark.parametrize("kappa", [0.7, 1.5])
def test_what_is_left_without_matching_is_what_is_predicted(setting, kappa):
    terms = setting[2]
    with float64():
        residual, predicted = unmatched_residual(terms, kappa, *REFINEMENTS[1])
        assert rms(residual - predicted) < 0.02 * rms(predicted)
        assert np.sum(predicted) * (kappa - 1) > 0
        matched_residual, zero = unmatched_residual(terms, 1.0, *REFINEMENTS[1])
        assert rms(matched_residual) < 0.02 * rms(predicted)
        np.testing.assert_allclose(zero, 0, atol=1e-12)


def test_the_cost_is_not_quadratic_but_where_the_grid_ends(setting):
    terms = setting[2]
    with float64():
        for mu, near in (
            (np.array([-0.6, 1.1]), True),
            (np.array([-terms.reach, terms.reach]), False),
        ):
            gap = np.abs(terms.running(mu) - quadratic(terms.far_running, mu))
            assert np.all(gap > 0.3) if near else np.all(gap < 1e-12)


def test_costs_do_not_depend_on_the_block_they_are_computed_in(setting, monkeypatch):
    terms = setting[2]
    with float64():
        mu = np.linspace(-3, 3, 10)
        expected = terms.running(mu)
        monkeypatch.setattr("mppi_belief.verify.scenarios.matched_scalar.COST_BLOCK", 4)
        np.testing.assert_allclose(terms.running(mu), expected, rtol=1e-14)
