"""Corollary 5's certificate: it holds, and it fails where corollary or package would."""

from collections.abc import Iterator

import jax
import numpy as np
import pytest

from helpers import float64, quick_jit
from mppi_belief.results.certificate import Certificate
from mppi_belief.verify.bands import largest_z, within_errors
from mppi_belief.verify.certificates import feynman_kac as fk
from mppi_belief.verify.estimates import fitted_rate
from mppi_belief.verify.scenarios import desirability_samples as samples
from mppi_belief.verify.scenarios.matched_paths import sampled_costs
from mppi_belief.verify.scenarios.matched_scalar import (
    MatchedProblem,
    SteadySchedule,
    matched_problem,
    scalar_equation,
    steady_schedule,
    with_time_grid,
)
from mppi_belief.verify.solvers.scalar_equations import ScalarEquation

KEY = 5


@pytest.fixture(scope="module")
def certificate() -> Iterator[Certificate]:
    with float64():
        yield fk.certify()


@pytest.fixture(scope="module")
def setting() -> Iterator[tuple[MatchedProblem, SteadySchedule, ScalarEquation]]:
    with float64():
        matched = matched_problem(steps=samples.COARSE_STEPS)
        along = steady_schedule(with_time_grid(matched, 1.0, 2 * samples.COARSE_STEPS), matched.cov)
        yield matched, along, scalar_equation(matched, along)


def agree(matched: MatchedProblem, along: SteadySchedule, terms: ScalarEquation) -> bool:
    points = samples.sample_points(matched, along, terms, jax.random.key(KEY))
    return largest_z("", points.z, samples.PSI_BATCHES - 1).holds


def test_the_certificate_holds(certificate):
    assert certificate.holds, [check.computed for check in certificate.checks if not check.holds]
    assert len(certificate.panels) == 2


def test_paths_of_another_diffusion_or_temperature_or_step_show(setting, monkeypatch):
    matched, along, terms = setting
    monkeypatch.setattr(samples, "PSI_TIMES", samples.PSI_TIMES[1:2])
    with float64():
        assert agree(matched, along, terms)
        assert not agree(matched, along._replace(factors=1.1 * along.factors), terms)
        assert not agree(matched._replace(temperature=1.02 * matched.temperature), along, terms)
        # The allowed bias comes from the levels alone and does not excuse that of the coarse step.
        log_desirabilities = samples.log_desirabilities
        monkeypatch.setattr(
            samples,
            "log_desirabilities",
            lambda *args: np.array(log_desirabilities(*args))[:, [0, 0]],
        )
        assert not agree(matched, along, terms)


def test_a_psi_of_the_linear_equation_that_is_off_shows(setting):
    _, _, terms = setting
    with float64():
        exact, error = samples.linear_equation_solution(terms)
        unused = np.ones_like(exact)
        for factor, holds in ((1.0, True), (1.001, False)):
            _, limit = fk.order_checks(
                terms,
                samples.DesirabilityPoints(factor * exact, error, unused, unused, unused),
            )
            assert limit.holds == holds


@pytest.mark.parametrize("broken", ["shifted", "repeated"])
def test_biased_or_dependent_samples_show(setting, monkeypatch, broken):
    matched, along, terms = setting
    pooled = samples.pooled_costs

    def spoilt(matched, along, mean, key, paths):
        if broken == "shifted":
            costs, increments = pooled(matched, along, mean, key, paths)
            return costs + 0.3, increments
        costs, increments = pooled(matched, along, mean, key, paths // 2)
        return np.repeat(costs, 2), np.repeat(increments, 2)

    monkeypatch.setattr(samples, "PSI_SIZES", samples.PSI_SIZES[2::3])
    monkeypatch.setattr(samples, "pooled_costs", spoilt)
    with float64():
        sampled_rate = samples.sample_rate(matched, along, terms, jax.random.key(KEY))
        slope, error = fitted_rate(samples.PSI_SIZES, sampled_rate.rms, sampled_rate.relative)
    assert not within_errors("", sampled_rate.squared, 1.0, sampled_rate.squared_error).holds
    # twice each sample leaves the rate as it is, a bias does not
    assert within_errors("", slope, -0.5, error).holds == (broken == "repeated")


def test_the_paths_are_those_of_a_loop(setting, rng):
    matched, along, _ = setting
    with float64():
        problem = with_time_grid(matched, 0.8, 4)
        terms = setting[2]
        eps = rng.normal(size=(4, 1, 3))
        costs, pushed = quick_jit(sampled_costs)(
            problem, matched.theta, np.array([0.7]), along, eps
        )
        np.testing.assert_allclose(
            np.abs(pushed), np.sqrt(terms.diffusion) * np.abs(eps), rtol=1e-12
        )
        for i in range(3):
            mu = np.array([0.7])
            total = 0.0
            for k in range(4):
                total += terms.running(mu)[0] * 0.2
                mu = mu * (1 + terms.drift * 0.2) + np.asarray(pushed)[k, 0, i]
            assert costs[i] == pytest.approx(total + terms.terminal(mu)[0], rel=1e-12)


def test_the_schedule_of_fewer_steps_is_the_beginning_of_that_of_more(setting):
    matched, along, _ = setting
    with float64():
        shorter = steady_schedule(with_time_grid(matched, 0.3, 4), matched.cov)
        np.testing.assert_allclose(shorter.cov, along.cov[:5], rtol=1e-12)
        np.testing.assert_allclose(shorter.factors, along.factors[:4], rtol=1e-12)
        assert set(np.asarray(along.ranks)) == {1}
