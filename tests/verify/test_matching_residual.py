"""The matching residual of Sec. VII: its certificate, that it can fail, and its closed forms."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are, solve_discrete_are

from helpers import float64
from mppi_belief.matching import constant_weight as matching
from mppi_belief.verify.certificates import matching_residual as certificate
from mppi_belief.verify.scenarios import residual_readings
from mppi_belief.verify.scenarios.section_vii import light_dark_numbers
from mppi_belief.verify.solvers import weight_optimality


@pytest.fixture(scope="module")
def computed():
    with float64():
        return certificate.certify(1)


def failing(checks):
    return [check.computed for check in checks if not check.holds]


def test_the_certificate_holds(computed):
    assert computed.holds, [check for check in computed.checks if not check.holds]
    assert len(computed.checks) == 10
    assert [len(panel.lines) for panel in computed.panels] == [3, 6]


def test_the_text_reports_the_readings(computed):
    assert "none of them is 0.79" in computed.text
    for reading in ("0.800", "0.801", "0.569", "0.0947", "0.297", "0.787"):
        assert reading in computed.text


def test_a_wrong_closed_form_is_seen(x64, monkeypatch):
    right = certificate.closed_residual
    rest = {
        name: certificate.closed_residual(certificate.SIGMAS, name) for name in certificate.METHODS
    }
    monkeypatch.setattr(certificate, "residuals_at_rest", lambda sigma_o, name: rest[name])
    assert failing(certificate.rest_checks()) == []
    monkeypatch.setattr(
        certificate, "closed_residual", lambda *arguments: right(*arguments) * (1 + 1e-10)
    )
    assert len(failing(certificate.rest_checks())) == 2
    monkeypatch.setattr(certificate, "closed_residual", right)
    monkeypatch.setattr(certificate, "residuals_at_rest", lambda sigma_o, name: rest[name][::-1])
    assert len(failing(certificate.rest_checks())) == 2


def test_a_worse_weight_is_seen(x64, monkeypatch):
    best = weight_optimality.best_constant_weight
    for gap in ({}, {"gap": 0.0}):  # whatever the search says of itself

        def hasty(D, G, *rest, gap=gap):
            return best(D, G, iterations=3)._replace(**gap)

        monkeypatch.setattr(weight_optimality, "best_constant_weight", hasty)
        failed = failing(weight_optimality.optimal_weight_checks(np.random.default_rng(0)))
        for text in ("duality gap", "300 other", "least sum of squares"):
            assert any(text in name for name in failed)


@pytest.mark.parametrize("floor", [-1e-3, -1e-9])
def test_a_search_among_weights_that_are_not_quite_positive_is_seen(floor, x64, monkeypatch):
    def clipped(M):
        values, vectors = np.linalg.eigh((M + M.T) / 2)
        return (vectors * np.maximum(values, floor)) @ vectors.T

    monkeypatch.setattr(matching, "nearest_psd", clipped)
    failed = failing(weight_optimality.optimal_weight_checks(np.random.default_rng(0)))
    assert any("least eigenvalue of the best" in computed for computed in failed)


def test_a_gap_bounds_what_is_left(x64, rng):
    """Compare with the package's search and gap, from any W >= 0."""
    D, G = weight_optimality.turning_controls(rng)
    least = matching.best_constant_weight(D, G).value
    for size in (1e-3, 1.0, 30.0):
        factor = rng.normal(size=(2, 2)) * size
        value, gap = weight_optimality.duality_gap(D, G, factor @ factor.T)
        assert 0 < value - least < gap
        assert gap == pytest.approx(matching.optimality_gap(D, G, factor @ factor.T), rel=1e-9)


def test_a_step_that_is_not_best_is_seen(x64, monkeypatch):
    line = {
        "sample": residual_readings.line_residuals(
            "sample", residual_readings.start_position(), residual_readings.goal_position()
        )
    }
    assert failing(certificate.line_checks(line)) == []
    best = certificate.best_weight
    monkeypatch.setattr(certificate, "best_weight", lambda D, G: 1.0001 * best(D, G))
    assert len(failing(certificate.line_checks(line))) == 1


@pytest.mark.parametrize("sigma_o", [0.03, 0.1, 0.3, 3.0])
def test_the_closed_forms_are_those_of_the_riccati_equations(sigma_o):
    q = light_dark_numbers()["process_noise"] ** 2
    C = np.eye(1, 2)

    def residual(K):
        return np.sqrt(1 - (K[1] ** 2 / (K[0] ** 2 + K[1] ** 2)) ** 2)

    S = solve_continuous_are(
        np.array([[0.0, 0], [1, 0]]), C.T, np.diag([0, q]), sigma_o**2 * np.eye(1)
    )
    assert certificate.closed_residual(sigma_o, "intensity") == pytest.approx(
        residual(S[:, 0]), rel=1e-9
    )
    for dt in (0.1, 0.5):
        P = solve_discrete_are(
            np.array([[1.0, 0], [dt, 1]]), C.T, np.diag([0, q * dt]), sigma_o**2 * np.eye(1)
        )
        assert certificate.closed_residual(sigma_o, "sample", dt) == pytest.approx(
            residual(P[:, 0]), rel=1e-9
        )


def test_sampling_an_intensity_ever_faster_tends_to_it_at_second_order():
    limit = certificate.closed_residual(0.1, "intensity")
    errors = [
        float(certificate.closed_residual(0.1 / dt**0.5, "sample", dt) - limit)
        for dt in (0.2, 0.1, 0.05, 0.025)
    ]
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2, atol=0.05)
