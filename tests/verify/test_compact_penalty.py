"""The variance of a compact penalty as a margin: its certificate holds, and fails for others."""

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.stats import norm

from certificate_helpers import assert_holds
from helpers import float64
from mppi_belief.results.certificate import Certificate
from mppi_belief.verify.certificates import compact_penalty
from mppi_belief.verify.scenarios import penalty_reach
from mppi_belief.verify.scenarios.penalty_reach import (
    DEVIATION,
    MARGIN,
    RADIUS,
    Charges,
    charges,
    exact_reach,
    hinge_moments,
)


@pytest.fixture(scope="module")
def certificate() -> Iterator[Certificate]:
    with float64():
        yield compact_penalty.certify(0)


def test_the_certificate_holds(certificate):
    assert_holds(certificate)


def test_exact_moments_pass_every_margin_and_sigma_points_none(certificate):
    lines = {line.label: np.asarray(line.y) for line in certificate.panels[1].lines}
    limit = MARGIN + 2 * DEVIATION
    assert np.all(lines["sigma points"] < limit)
    assert np.all(lines["chance constraint"] < limit)
    assert np.all(lines["rule of 37 nodes"] < MARGIN + 3 * DEVIATION)
    assert np.all(np.diff(lines["exact moments"]) > 0.5 * DEVIATION)
    assert lines["exact moments"][-1] > MARGIN + 5 * DEVIATION


def test_another_margin_is_noticed(monkeypatch, x64):
    by_points, chance, quadrature = charges()
    wrong = Charges(chance, quadrature, by_points)
    monkeypatch.setattr(compact_penalty, "charges", lambda theta=1.0: wrong)
    assert not compact_penalty.sigma_point_checks()[0].holds
    assert [check.holds for check in compact_penalty.margin_checks()] == [False, False]


@pytest.mark.parametrize("distance", [0.1, 0.4, 1.0])
def test_moments_of_the_hinge_beside_a_large_disc_are_those_beside_a_wall(monkeypatch, distance):
    monkeypatch.setattr(penalty_reach, "RADIUS", 1e4 * RADIUS)
    z = (distance - MARGIN) / DEVIATION
    expected = (
        DEVIATION * (norm.pdf(z) - z * norm.sf(z)),
        DEVIATION**2 * ((1 + z**2) * norm.sf(z) - z * norm.pdf(z)),
    )
    np.testing.assert_allclose(hinge_moments(distance), expected, rtol=1e-3)


def test_the_distance_of_exact_moments_depends_on_the_product_of_theta_and_the_squared_weight():
    """Where the expectation is small beside the variance."""
    np.testing.assert_allclose(exact_reach(1e5, theta=100.0), exact_reach(1e6), rtol=1e-4)
