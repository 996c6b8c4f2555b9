"""Theorem 4's certificate: that it holds, and that it fails where the theorem or the package would."""

from collections.abc import Iterator

import numpy as np
import pytest

from helpers import float64
from mppi_belief.results.certificate import Certificate
from mppi_belief.verify import pde
from mppi_belief.verify.certificates import cole_hopf
from mppi_belief.verify.matched_problem import Matched, Steady, equation, matched_problem, steady


@pytest.fixture(scope="module")
def certificate() -> Iterator[Certificate]:
    with float64():
        yield cole_hopf.certify()


@pytest.fixture(scope="module")
def setting() -> Iterator[tuple[Matched, Steady, pde.Equation]]:
    with float64():
        matched = matched_problem()
        along = steady(matched.problem, matched.cov)
        yield matched, along, equation(matched, along)


def failed(certificate: Certificate) -> str:
    return "\n".join(check.computed for check in certificate.checks if not check.holds)


def test_the_certificate_holds(certificate):
    assert certificate.holds, failed(certificate)
    assert len(certificate.panels) == 3


def test_a_wrong_sign_in_front_of_the_gradient_term_shows(monkeypatch, x64):
    value = pde.value

    def wrong(terms: pde.Equation, on: pde.Grid) -> tuple[np.ndarray, float]:
        return value(terms._replace(authority=0.9 * terms.authority), on)

    monkeypatch.setattr(pde, "value", wrong)
    broken = cole_hopf.certify()
    assert "V by (13), method of lines: order" in failed(broken)
    assert "V by (13) from the Riccati solution" in failed(broken)


def test_a_transform_of_another_temperature_shows(monkeypatch, x64):
    desirability = pde.desirability
    monkeypatch.setattr(
        pde, "desirability", lambda terms, on: np.abs(desirability(terms, on)) ** 1.01
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
        off = steady(matched.problem, 1.001 * matched.cov)
        assert not cole_hopf._matching(matched, off).holds


def test_another_control_weight_shows_in_the_minimum(setting):
    matched, _, terms = setting
    with float64():
        solved = cole_hopf.solve(terms, 280, 20)
        assert all(check.holds for check in cole_hopf._minimised(matched, terms, solved))
        heavier = matched_problem(temperature=1.001 * matched.temperature)
        assert not all(check.holds for check in cole_hopf._minimised(heavier, terms, solved))


def test_what_is_drawn_without_matching_is_the_prediction(certificate):
    found, predicted = certificate.panels[-1].lines
    assert predicted.y[predicted.x.index(1.0)] == 0.0
    between = np.interp(found.x, predicted.x, predicted.y)
    np.testing.assert_allclose(found.y, between, atol=0.02 * max(predicted.y))


@pytest.mark.parametrize("kappa", [0.7, 1.5])
def test_what_is_left_without_matching_is_what_is_predicted(setting, kappa):
    terms = setting[2]
    with float64():
        found, predicted = cole_hopf.mismatch(terms, kappa, *cole_hopf.GRIDS[1])
        assert cole_hopf.rms(found - predicted) < 0.02 * cole_hopf.rms(predicted)
        assert np.sum(predicted) * (kappa - 1) > 0
        nothing, none = cole_hopf.mismatch(terms, 1.0, *cole_hopf.GRIDS[1])
        assert cole_hopf.rms(nothing) < 0.02 * cole_hopf.rms(predicted)
        np.testing.assert_allclose(none, 0, atol=1e-12)


def test_the_cost_is_not_quadratic_but_where_the_grid_ends(setting):
    terms = setting[2]
    with float64():
        for mu, near in (
            (np.array([-0.6, 1.1]), True),
            (np.array([-terms.reach, terms.reach]), False),
        ):
            gap = np.abs(terms.running(mu) - pde.quadratic(terms.far_running, mu))
            assert np.all(gap > 0.3) if near else np.all(gap < 1e-12)


def test_costs_do_not_depend_on_the_block_they_are_computed_in(setting, monkeypatch):
    terms = setting[2]
    with float64():
        mu = np.linspace(-3, 3, 10)
        whole = terms.running(mu)
        monkeypatch.setattr("mppi_belief.verify.matched_problem.BLOCK", 4)
        np.testing.assert_allclose(terms.running(mu), whole, rtol=1e-14)
