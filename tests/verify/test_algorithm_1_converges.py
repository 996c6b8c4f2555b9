"""Algorithm 1 in closed loop: its certificate, that it can fail, and its Gaussian integrals."""

import dataclasses
import math

import numpy as np
import pytest

import reference
from helpers import SIGMAS, float64
from mppi_belief.results.certificate import Certificate
from mppi_belief.verify.bands import quantile
from mppi_belief.verify.certificates import algorithm_1 as a1
from mppi_belief.verify.estimates import standard_error
from mppi_belief.verify.scenarios import stationary_scalar as scalar
from mppi_belief.verify.scenarios.scalar_loops import (
    ScalarLoops,
    closed_loops,
    receding_algorithm,
)

TRIALS = 300


@pytest.fixture(scope="module")
def certificate() -> Certificate:
    with float64():
        return a1.certify(0)


@pytest.fixture(scope="module")
def expected() -> scalar.PredictedExcess:
    with float64():
        problem, optimum = scalar.stationary_problem()
        return scalar.predicted_excess(problem, optimum, *scalar.filter_law(problem))


def forms_like(excess: np.ndarray) -> np.ndarray:
    """Draw quadratic forms (samples, trials) with these means, skewed as sums of squares are."""
    draws = np.random.default_rng(0).gamma(4, 0.25, size=(len(excess), TRIALS))
    return excess[:, None] * draws / draws.mean(axis=1, keepdims=True)


def verdicts(
    forms: np.ndarray, expected: scalar.PredictedExcess, paired: np.ndarray | None = None
) -> list[bool]:
    noise = np.random.default_rng(1).normal(size=forms.shape)
    noise -= noise.mean(axis=1, keepdims=True)
    return [
        c.holds
        for c in a1.excess_checks(forms + noise if paired is None else paired, forms, expected, 3.0)
    ]


def test_the_certificate_holds(certificate):
    assert certificate.holds, [check for check in certificate.checks if not check.holds]
    assert 4 <= len(certificate.checks) <= 10
    for panel in certificate.panels:
        for line in panel.lines:
            assert np.all(np.isfinite(line.y))
            assert len(line.x) == len(line.y)


def test_an_excess_that_falls_otherwise_is_seen(expected):
    N = np.array(a1.SAMPLES)
    assert verdicts(forms_like(expected.excess(N)), expected) == [True] * 5
    slow = expected.floor + expected.per_sample / 16 * np.sqrt(16 / N)
    assert verdicts(forms_like(slow), expected) == [True, False, False, False, False]
    higher = expected._replace(floor=3 * expected.floor).excess(N)
    assert verdicts(forms_like(higher), expected) == [True, False, False, False, False]


def test_points_whose_interval_reaches_below_zero_are_drawn(certificate):
    paired, forms = certificate.panels[0].lines[2:]
    assert list(forms.x) == list(a1.SAMPLES)
    assert np.all(
        np.less(0, paired.low) & np.less(paired.low, paired.y) & np.less(paired.y, paired.high)
    )
    wide = a1.excess_points("", np.array([[-1.0, 3.0, 1.0], [-1.0, -3.0, -1.0]] * 2), 100.0)
    assert list(wide.x) == [a1.SAMPLES[0], a1.SAMPLES[2]]
    np.testing.assert_allclose(wide.low, 0.1)


def test_a_cost_that_is_not_the_quadratic_form_is_seen(expected):
    forms = forms_like(expected.excess(np.array(a1.SAMPLES)))
    shifted = forms + np.random.default_rng(1).normal(1.0, 1.0, size=forms.shape)
    assert verdicts(forms, expected, shifted)[0] is False


def test_another_temperature_than_the_matched_one_does_not_cost_what_is_predicted(expected, x64):
    problem, optimum = scalar.stationary_problem()
    warm = dataclasses.replace(receding_algorithm(1024), temperature=2 * scalar.SCALAR_TEMPERATURE)
    run = closed_loops(problem, warm, 0, 50)
    form = 0.5 * optimum.hessian * np.sum((run.control + optimum.gain * run.mean) ** 2, axis=1)
    assert form.mean() - expected.excess(1024) > quantile(1, 49) * standard_error(form)


def test_a_controller_that_is_not_the_optimum_is_seen(x64):
    problem, optimum = scalar.stationary_problem()
    mean = np.ones((10, scalar.SCALAR_STEPS))
    best = scalar.scalar_optimal_cost(problem, optimum, scalar.filter_law(problem)[0])
    costs = best + np.linspace(-1, 1, 10)
    wrong_gain = ScalarLoops(costs, mean, -(optimum.gain + 1e-6) * mean)
    assert [c.holds for c in a1.optimum_checks(problem, optimum, best, wrong_gain)] == [
        True,
        False,
        True,
    ]
    wrong = optimum._replace(gain=optimum.gain * (1 + 1e-6))
    right = ScalarLoops(costs + 10, mean, -wrong.gain * mean)
    assert [c.holds for c in a1.optimum_checks(problem, wrong, best, right)] == [
        False,
        True,
        False,
    ]


@pytest.mark.parametrize("tau", [1.0, 0.5])
def test_the_tilted_paths_are_those_of_the_reference(tau, monkeypatch):
    """Compare with the precision matrix of all increments at once."""
    a = 0.3
    b = scalar.CONTROL_GAIN
    q = scalar.STATE_WEIGHT
    q_T = 1.7
    dt = scalar.SCALAR_DT
    steps = 6
    D = 0.4
    mean = 1.1
    monkeypatch.setattr(scalar, "DRIFT", a)
    exact = reference.gaussian_paths(a, b, D, q, q_T, mean, dt, steps, tau)
    tilt = scalar.weighted_paths(np.full((1, steps), D), q_T, tau)
    assert -tilt.pull[0] * mean / (b * dt) == pytest.approx(exact.control, rel=1e-12)
    assert -tilt.value[0] * mean**2 / (2 * tau) - tilt.constant[0] == pytest.approx(
        exact.log_psi, rel=1e-12
    )


def test_the_optimal_cost_is_that_of_the_joint_second_moments(x64):
    """Propagate the moments of the state and its estimate, step by step."""
    problem, optimum = scalar.stationary_problem()
    covs, innovations = scalar.filter_law(problem)
    R = float(problem.cost.R[0, 0])
    B = scalar.CONTROL_GAIN * scalar.SCALAR_DT
    K = optimum.gain
    square = float(problem.prior_mean[0]) ** 2  # E mu^2; E x^2 is that and the covariance
    cost = 0.0
    for cov, innovation in zip(covs, innovations, strict=True):
        cost += 0.5 * (scalar.STATE_WEIGHT * (square + cov) + R * K**2 * square) * scalar.SCALAR_DT
        square = (1 - B * K) ** 2 * square + innovation
    last = covs[-1] + scalar.SCALAR_NOISE**2 * scalar.SCALAR_DT - innovations[-1]
    cost += 0.5 * optimum.value * (square + last)
    assert scalar.scalar_optimal_cost(problem, optimum, covs) == pytest.approx(cost, rel=1e-12)


def test_the_prediction_is_the_spread_of_a_ratio_of_averages(x64):
    """Sample the paths of the first control in NumPy, from a known mean."""
    problem, optimum = scalar.stationary_problem()
    covs, innovations = (part[:1] for part in scalar.filter_law(problem))
    predicted = scalar.predicted_excess(problem, optimum, covs, innovations)
    D = scalar.planned_diffusions(problem, covs)[0]
    rng = np.random.default_rng(0)
    pushed = np.sqrt(D * scalar.SCALAR_DT)[:, None] * rng.normal(size=(len(D), 400_000))
    B = scalar.CONTROL_GAIN * scalar.SCALAR_DT
    mu = 1 + np.vstack([0 * pushed[:1], np.cumsum(pushed, axis=0)])
    w = np.exp(
        -0.5 * scalar.STATE_WEIGHT * scalar.SCALAR_DT * np.sum(mu[:-1] ** 2, axis=0)
        - 0.5 * optimum.value * mu[-1] ** 2
    )
    w /= w.mean()
    error = pushed[0] / B + optimum.gain  # of one sample, from the optimal control at mu = 1
    wrong = np.mean(w * error)
    # E e^2 for N samples: wrong^2 + (spread + 2 wrong bias) / N
    sampling = w**2 * (error - wrong) ** 2 - 2 * wrong * w**2 * (error - wrong)
    shift = math.sqrt(2 * predicted.floor / optimum.hessian)
    assert abs(wrong) == pytest.approx(shift, abs=SIGMAS * standard_error(w * (error - wrong)))
    tolerance = SIGMAS * 0.5 * optimum.hessian * standard_error(sampling)
    assert 0.5 * optimum.hessian * sampling.mean() == pytest.approx(
        predicted.per_sample, abs=tolerance
    )
    assert np.mean(w**2) == pytest.approx(predicted.next_term, abs=SIGMAS * standard_error(w**2))
