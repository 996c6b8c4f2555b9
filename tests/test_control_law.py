"""Theorem 6's certificate: that it holds, and that it fails where the theorem or the package would."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb
from helpers import SIGMAS, float64, quick_jit
from mppi_belief import path_integral as pi
from mppi_belief.certificate import Certificate, largest_z
from mppi_belief.verify import control_law as law
from mppi_belief.verify import pde, underactuated
from mppi_belief.verify.matched_problem import Matched, Steady, equation, matched_problem, steady

KEY = 5


@pytest.fixture(scope="module")
def certificate() -> Iterator[Certificate]:
    with float64():
        yield law.certify()


@pytest.fixture(scope="module")
def setting() -> Iterator[tuple[Matched, Steady, pde.Equation]]:
    with float64():
        matched = matched_problem(steps=law.STEPS[0])
        along = steady(matched.problem, matched.cov)
        yield matched, along, equation(matched, along)


@pytest.fixture(scope="module")
def double_integrator() -> Iterator[tuple[mb.Problem, np.ndarray, float, Steady]]:
    with float64():
        problem, cov, temperature = underactuated.underactuated()
        yield problem, cov, temperature, steady(problem, cov)


def test_the_certificate_holds(certificate):
    assert certificate.holds, [check.computed for check in certificate.checks if not check.holds]
    assert len(certificate.panels) == 3


@pytest.mark.parametrize(("factor", "holds"), [(1.0, True), (1.002, False)])
def test_another_control_map_shows_in_the_limit(setting, factor, holds):
    matched, _, terms = setting
    with float64():
        expected = np.stack([law.exact(matched, terms, H, law.MEANS) for H in law.STEPS])
        assert law._limit(factor * expected, *law.optimal(matched, terms, law.MEANS)).holds == holds


def test_another_cost_shows_in_the_linear_quadratic_case(setting, monkeypatch):
    along = setting[1]
    with float64():
        assert law._linear_quadratic(along).holds
        monkeypatch.setattr(law, "matched_problem", lambda w_obs, theta: matched_problem(1e-6, 0.0))
        assert not law._linear_quadratic(along).holds


def test_another_temperature_shows_in_the_samples(setting):
    matched, _, terms = setting
    with float64():
        for factor, holds in ((1.0, True), (1.2, False)):
            sampled = law.sample(matched._replace(temperature=factor * 0.6), terms, jax.random.key(KEY))
            assert largest_z("", sampled.z, law.KEYS - 1).holds == holds


def test_bias_and_variance_of_the_estimate_are_those_of_samples(rng):
    """One step, in NumPy: N = 100, of which the next order in 1 / N is a hundredth of these."""
    N, batches, mean = 100, 20_000, -0.5
    with float64():
        matched = matched_problem(steps=1)
        terms = equation(matched, steady(matched.problem, matched.cov))
        found = law.estimate(matched, terms, np.array([mean]))
        pushed = np.sqrt(terms.diffusion) * rng.normal(size=(batches, N))
        weights = np.exp(-terms.terminal((mean * (1 + terms.drift) + pushed).ravel()) / terms.temperature)
    weights = weights.reshape(batches, N)
    u = np.sum(weights * pushed, axis=1) / np.sum(weights, axis=1) / 0.8  # b
    error = u.std() / np.sqrt(batches)
    assert abs(found.bias[0] / N) > 2 * error
    assert abs(u.mean() - found.control[0] - found.bias[0] / N) < SIGMAS * error
    assert N * u.var() == pytest.approx(found.variance[0], rel=SIGMAS * np.sqrt(2 / batches) + 5 / N)


def test_the_diffusion_of_the_double_integrator_has_rank_one(double_integrator):
    problem, cov, temperature, along = double_integrator
    assert set(np.asarray(along.ranks)) == {1}
    assert np.linalg.matrix_rank(np.asarray(problem.system.H)) == 2
    np.testing.assert_allclose(along.cov, np.broadcast_to(cov, along.cov.shape), atol=1e-12)
    G, R = np.asarray(problem.system.B), np.asarray(problem.cost.R)
    np.testing.assert_allclose(along.diffusion[0], temperature * G @ np.linalg.solve(R, G.T), atol=1e-12)


def test_a_diffusion_beside_the_control_channel_shows(double_integrator):
    problem, _, temperature, along = double_integrator
    with float64():
        assert all(check.holds for check in underactuated._algebra(problem, along, temperature))
        beside = along._replace(diffusion=along.diffusion + 1e-6 * jnp.eye(2))
        assert not any(check.holds for check in underactuated._algebra(problem, beside, temperature))


def test_a_control_map_that_sees_the_rest_of_the_space_shows(double_integrator, monkeypatch):
    problem, _, temperature, along = double_integrator
    monkeypatch.setattr(pi, "control_map", lambda G, R: jnp.array([[1e-9, 1.0]]))
    with float64():
        matching, mapped = underactuated._algebra(problem, along, temperature)
    assert matching.holds
    assert not mapped.holds


def test_the_double_integrators_exact_control_is_lqg_of_the_same_steps(double_integrator):
    problem, cov, temperature, along = double_integrator
    with float64():
        controller = mb.LQG(charge="start")

        @quick_jit
        def act(problem: mb.Problem, state: jax.Array) -> jax.Array:
            plan = controller.init(problem)
            return controller.act(problem, mb.Belief(state, jnp.asarray(cov)), plan, jax.random.key(0))[0][0]

        for state in underactuated.STATES:
            u, _ = underactuated.exact(problem, along, temperature, state, problem.steps)
            assert float(act(problem, state)) == pytest.approx(u, abs=1e-11)


def test_another_belief_shows_in_the_double_integrators_samples(double_integrator):
    problem, cov, temperature, along = double_integrator
    with float64():
        key = jax.random.key(KEY)
        assert largest_z("", underactuated.sample(problem, cov, along, temperature, key).z, 63).holds
        wider = underactuated.sample(problem, 1.2 * cov, along, temperature, key)
        assert not largest_z("", wider.z, 63).holds
