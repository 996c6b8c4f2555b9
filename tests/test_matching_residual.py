"""The matching residual of Sec. VII: its certificate, that it can fail, and its closed forms against SciPy."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are, solve_discrete_are

from helpers import float64
from mppi_belief.verify import matching_residual as certificate


@pytest.fixture(scope="module")
def found():
    with float64():
        return certificate.certify(1)


def failing(checks):
    return [check.computed for check in checks if not check.holds]


def test_the_certificate_holds(found):
    assert found.holds, [check for check in found.checks if not check.holds]
    assert len(found.checks) == 10
    assert [len(panel.lines) for panel in found.panels] == [3, 6]


def test_the_text_reports_the_readings(found):
    assert "none of them is 0.79" in found.text
    for reading in ("0.800", "0.801", "0.569", "0.0947", "0.297"):
        assert reading in found.text


def test_a_wrong_closed_form_is_seen(x64, monkeypatch):
    right = certificate.closed_form
    rest = {name: certificate.closed_form(certificate.SIGMAS, name) for name in certificate.METHOD}
    monkeypatch.setattr(certificate, "at_rest", lambda sigma_o, name: rest[name])
    assert failing(certificate._at_rest()) == []
    monkeypatch.setattr(certificate, "closed_form", lambda *arguments: right(*arguments) * (1 + 1e-10))
    assert len(failing(certificate._at_rest())) == 2
    monkeypatch.setattr(certificate, "closed_form", right)
    monkeypatch.setattr(certificate, "at_rest", lambda sigma_o, name: rest[name][::-1])
    assert len(failing(certificate._at_rest())) == 3


def test_a_worse_weight_is_seen(x64, monkeypatch):
    best = certificate.best_constant_weight

    def hasty(D, G):
        return best(D, G, iterations=3)

    monkeypatch.setattr(certificate, "best_constant_weight", hasty)
    failed = failing(certificate._least(np.random.default_rng(0)))
    assert any("duality gap" in computed for computed in failed)

    def boastful(D, G):
        return hasty(D, G)._replace(gap=0.0)

    monkeypatch.setattr(certificate, "best_constant_weight", boastful)
    failed = failing(certificate._least(np.random.default_rng(0)))
    assert any("300 other" in computed for computed in failed)
    assert any("least sum of squares" in computed for computed in failed)


def test_a_step_that_is_not_best_is_seen(x64, monkeypatch):
    nominal = {"sample": certificate.along("sample", certificate.START, certificate.GOAL)}
    assert failing(certificate._constant(nominal)) == []
    best = certificate.best_weight
    monkeypatch.setattr(certificate, "best_weight", lambda D, G: 1.0001 * best(D, G))
    assert len(failing(certificate._constant(nominal))) == 1


@pytest.mark.parametrize("sigma_o", [0.03, 0.1, 0.3, 3.0])
def test_the_closed_forms_are_those_of_the_riccati_equations(sigma_o):
    q, C = certificate.SIGMA_W**2, np.eye(1, 2)

    def residual(K):
        return np.sqrt(1 - (K[1] ** 2 / (K[0] ** 2 + K[1] ** 2)) ** 2)

    S = solve_continuous_are(np.array([[0.0, 0], [1, 0]]), C.T, np.diag([0, q]), sigma_o**2 * np.eye(1))
    assert certificate.closed_form(sigma_o, "intensity") == pytest.approx(residual(S[:, 0]), rel=1e-9)
    for dt in (0.1, 0.5):
        P = solve_discrete_are(np.array([[1.0, 0], [dt, 1]]), C.T, np.diag([0, q * dt]), sigma_o**2 * np.eye(1))
        assert certificate.closed_form(sigma_o, "sample", dt) == pytest.approx(residual(P[:, 0]), rel=1e-9)


def test_sampling_an_intensity_ever_faster_tends_to_it_at_second_order():
    limit = certificate.closed_form(0.1, "intensity")
    errors = [float(certificate.closed_form(0.1 / dt**0.5, "sample", dt) - limit) for dt in (0.2, 0.1, 0.05, 0.025)]
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2, atol=0.05)
