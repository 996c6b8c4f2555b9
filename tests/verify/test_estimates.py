"""Sizes, rates and limits of errors."""

import numpy as np
import pytest

from mppi_belief.verify.estimates import (
    RepeatedControls,
    extrapolations,
    fitted_rate,
    limit_check,
    rms,
    standard_error,
)


def test_sizes_of_errors():
    assert rms([[3.0, 4.0], [0.0, 0.0]]) == pytest.approx(2.5)
    assert standard_error(np.array([1.0, 3.0, 1.0, 3.0])) == pytest.approx((4 / 3) ** 0.5 / 2)


def test_the_rate_is_a_weighted_fit(rng):
    sizes = 2 ** np.arange(3, 9)
    relative = rng.uniform(0.02, 0.2, 6)
    errors = sizes**-0.4 * np.exp(relative * rng.normal(size=6))
    slope, error = fitted_rate(sizes, errors, relative)
    fit, cov = np.polyfit(np.log(sizes), np.log(errors), 1, w=1 / relative, cov="unscaled")
    assert slope == pytest.approx(fit[0])
    assert error == pytest.approx(np.sqrt(cov[0, 0]))


def test_extrapolation_removes_the_first_order_term():
    steps = 0.5 ** np.arange(4)
    levels = [np.array([2.0 + 3.0 * h, 1.0 - h]) for h in steps]
    np.testing.assert_allclose(extrapolations(levels), [[2.0, 1.0]] * 3)


@pytest.mark.parametrize(("error", "holds"), [(0.0, True), (0.05, False)])
def test_a_wrong_limit_is_seen_beyond_the_second_order_term(error, holds):
    levels = [np.array([1.0 + h + 0.1 * h**2]) for h in 0.5 ** np.arange(4)]
    assert limit_check("x", levels, np.array([1.0 + error]), np.zeros(1)).holds == holds


def test_repeated_controls_know_the_error_of_their_mean(rng):
    controls = RepeatedControls(rng.normal(size=(400, 3)), np.zeros(3))
    np.testing.assert_allclose(controls.error, 1 / 20, rtol=0.15)
    np.testing.assert_allclose(controls.z, controls.mean / controls.error)
