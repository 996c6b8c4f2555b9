"""Theorem 6's certificate: it holds, and it fails where the theorem or the package would."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb
from helpers import SIGMAS, float64, quick_jit
from mppi_belief.belief.cost import risk_sensitive
from mppi_belief.belief.schedule import GainSchedule
from mppi_belief.planning import path_integral as pi
from mppi_belief.planning import path_weights as pw
from mppi_belief.planning.samplers import innovation
from mppi_belief.planning.schedules import shared
from mppi_belief.results.certificate import Certificate
from mppi_belief.verify.bands import largest_z
from mppi_belief.verify.certificates import control_law as law
from mppi_belief.verify.scenarios import control_samples as samples
from mppi_belief.verify.scenarios import double_integrator as integrator
from mppi_belief.verify.scenarios import light_dark_by_hand as by_hand
from mppi_belief.verify.scenarios.matched_scalar import (
    MatchedProblem,
    SteadySchedule,
    matched_problem,
    scalar_equation,
    steady_schedule,
)
from mppi_belief.verify.solvers.scalar_equations import ScalarEquation

KEY = 5


@pytest.fixture(scope="module")
def certificate() -> Iterator[Certificate]:
    with float64():
        yield law.certify()


@pytest.fixture(scope="module")
def setting() -> Iterator[tuple[MatchedProblem, SteadySchedule, ScalarEquation]]:
    with float64():
        matched = matched_problem(steps=law.EXPECTATION_STEPS[0])
        along = steady_schedule(matched.problem, matched.cov)
        yield matched, along, scalar_equation(matched, along)


@pytest.fixture(scope="module")
def double_integrator() -> Iterator[tuple[mb.Problem, np.ndarray, float, SteadySchedule]]:
    with float64():
        problem, cov, temperature = integrator.double_integrator()
        yield problem, cov, temperature, steady_schedule(problem, cov)


def test_the_certificate_holds(certificate):
    assert certificate.holds, [check.computed for check in certificate.checks if not check.holds]
    assert len(certificate.panels) == 3


@pytest.mark.parametrize(("factor", "holds"), [(1.0, True), (1.002, False)])
def test_another_control_map_shows_in_the_limit(setting, factor, holds):
    matched, _, terms = setting
    with float64():
        expected = np.stack(
            [
                samples.exact_control(matched, terms, H, samples.CONTROL_MEANS)
                for H in law.EXPECTATION_STEPS
            ]
        )
        assert (
            law.short_step_check(
                factor * expected, *samples.optimal_control(matched, terms, samples.CONTROL_MEANS)
            ).holds
            == holds
        )


def test_another_cost_shows_in_the_linear_quadratic_case(setting, monkeypatch):
    along = setting[1]
    with float64():
        assert law.quadratic_cost_check(along).holds
        monkeypatch.setattr(law, "matched_problem", lambda w_obs, theta: matched_problem(1e-6, 0.0))
        assert not law.quadratic_cost_check(along).holds


def test_another_temperature_shows_in_the_samples(setting):
    matched, _, terms = setting
    with float64():
        for factor, holds in ((1.0, True), (1.2, False)):
            sampled = samples.sample_controls(
                matched._replace(temperature=factor * 0.6), terms, jax.random.key(KEY)
            )
            assert largest_z("", sampled.z, samples.CONTROL_KEYS - 1).holds == holds


def test_bias_and_variance_of_the_estimate_are_those_of_samples(rng):
    """Sample one step in NumPy; N = 100, so that the next order in 1 / N is a hundredth."""
    N = 100
    batches = 20_000
    mean = -0.5
    with float64():
        matched = matched_problem(steps=1)
        terms = scalar_equation(matched, steady_schedule(matched.problem, matched.cov))
        estimate = samples.control_estimate(matched, terms, np.array([mean]))
        pushed = np.sqrt(terms.diffusion) * rng.normal(size=(batches, N))
        weights = np.exp(
            -terms.terminal((mean * (1 + terms.drift) + pushed).ravel()) / terms.temperature
        )
    weights = weights.reshape(batches, N)
    u = np.sum(weights * pushed, axis=1) / np.sum(weights, axis=1) / 0.8  # b
    error = u.std() / np.sqrt(batches)
    assert abs(estimate.bias[0] / N) > 2 * error
    assert abs(u.mean() - estimate.control[0] - estimate.bias[0] / N) < SIGMAS * error
    assert N * u.var() == pytest.approx(
        estimate.variance[0], rel=SIGMAS * np.sqrt(2 / batches) + 5 / N
    )


def test_the_diffusion_of_the_double_integrator_has_rank_one(double_integrator):
    problem, cov, temperature, along = double_integrator
    assert set(np.asarray(along.ranks)) == {1}
    assert np.linalg.matrix_rank(np.asarray(problem.system.H)) == 2
    np.testing.assert_allclose(along.cov, np.broadcast_to(cov, along.cov.shape), atol=1e-12)
    G = np.asarray(problem.system.B)
    R = np.asarray(problem.cost.R)
    np.testing.assert_allclose(
        along.diffusion[0], temperature * G @ np.linalg.solve(R, G.T), atol=1e-12
    )


def test_a_diffusion_beside_the_control_channel_shows(double_integrator):
    problem, _, temperature, along = double_integrator
    with float64():
        assert all(check.holds for check in integrator.algebra_checks(problem, along, temperature))
        beside = along._replace(diffusion=along.diffusion + 1e-6 * jnp.eye(2))
        assert not any(
            check.holds for check in integrator.algebra_checks(problem, beside, temperature)
        )


def test_a_control_map_that_sees_the_rest_of_the_space_shows(double_integrator, monkeypatch):
    problem, _, temperature, along = double_integrator
    monkeypatch.setattr(pi, "control_map", lambda G, R: jnp.array([[1e-9, 1.0]]))
    with float64():
        matching, mapped = integrator.algebra_checks(problem, along, temperature)
    assert matching.holds
    assert not mapped.holds


def test_the_double_integrators_exact_control_is_lqg_of_the_same_steps(double_integrator):
    problem, cov, temperature, along = double_integrator
    with float64():
        controller = mb.LQG(at_step_end=False)

        @quick_jit
        def act(problem: mb.Problem, state: jax.Array) -> jax.Array:
            plan = controller.init(problem)
            return controller.act(
                problem, mb.Belief(state, jnp.asarray(cov)), plan, jax.random.key(0)
            )[0][0]

        for state in integrator.INTEGRATOR_STATES:
            u = integrator.expected_control(problem, along, temperature, state, problem.steps)
            assert float(act(problem, state)) == pytest.approx(u, abs=1e-11)


def test_the_increment_is_that_of_the_tilted_gaussian_by_quadrature(double_integrator):
    """Integrate one step, eps_0 alone, on a fine grid."""
    problem, _, temperature, along = double_integrator
    L = np.asarray(along.factors[0, :, 0])
    start = np.array([1.5, -0.5])
    cost = problem.cost
    F = np.eye(2) + np.array([[0.0, 1.0], [0.0, 0.0]]) * integrator.INTEGRATOR_DURATION
    eps = np.linspace(-9, 9, 2001)
    away = (F @ start - np.asarray(cost.goal))[:, None] + L[:, None] * eps
    weights = np.exp(-(eps**2) / 2 - np.asarray(cost.terminal_weight) @ away**2 / (2 * temperature))
    mean = weights @ eps / weights.sum()
    assert integrator.weighted_increment(problem, L, temperature, start, 1) == pytest.approx(
        mean, rel=1e-10
    )


@pytest.fixture(scope="module")
def flight(certificate) -> Iterator[tuple[mb.Problem, by_hand.PackageRun]]:
    with float64():
        problem = by_hand.moving_problem()
        yield problem, by_hand.package_run(problem, jax.random.key(KEY))


def test_the_schedule_is_in_transit(flight):
    """Check that D_k, Sigma_k and q_k vary, with weights that are neither even nor degenerate."""
    problem, run = flight
    with float64():
        for i, start in enumerate(by_hand.HAND_STARTS):
            covs, diffusions = by_hand.riccati_by_hand(problem, start)
            assert np.linalg.norm(diffusions[-1] - diffusions[0]) > np.linalg.norm(diffusions[0])
            # but for the trace of (4), which is the same for all paths
            traces = np.trace(np.diag(problem.cost.running_weight) @ covs, axis1=1, axis2=2) / 2
            q = [by_hand.risk_by_hand(problem, start[:, None], cov)[0] for cov in covs] - traces
            assert np.ptp(q) > 0.1
            costs = by_hand.hand_run(problem, start, run.factors[i], run.eps[i]).costs
            w = np.exp(-costs) / np.exp(-costs).sum()
            assert 5 < 1 / np.sum(w**2) < 0.75 * by_hand.HAND_SAMPLES


def test_factors_of_another_diffusion_show(flight):
    problem, run = flight
    start = by_hand.HAND_STARTS[0]
    factors = run.factors[0]
    eps = run.eps[0]
    with float64():
        assert by_hand.hand_run(problem, start, factors, eps).factor_error < 1e-13
        assert by_hand.hand_run(problem, start, 1.001 * factors, eps).factor_error > 1e-4


COSTS = shared.accumulated_costs
WEIGHTS = pw.weights
FACTORS = innovation.diffusion_factors


def frozen(schedule: GainSchedule) -> tuple[jax.Array, jax.Array]:
    factors, ranks = FACTORS(schedule)
    return jnp.broadcast_to(factors[0], factors.shape), ranks


MUTATIONS = {
    "temperature": (pw, "weights", lambda S, temperature: WEIGHTS(S, 1.03 * temperature)),
    "charge": (
        shared,
        "accumulated_costs",
        lambda p, m, s, covs, charged, *costs: COSTS(p, m, s, covs, (1.0,), *costs),
    ),
    "Sigma_k": (
        shared,
        "accumulated_costs",
        lambda p, m, s, covs, *rest: COSTS(p, m, s, jnp.broadcast_to(covs[0], covs.shape), *rest),
    ),
    "L_k": (innovation, "diffusion_factors", frozen),
}


@pytest.mark.parametrize("mutation", MUTATIONS)
def test_any_other_algorithm_shows_line_by_line(monkeypatch, x64, mutation):
    monkeypatch.setattr(*MUTATIONS[mutation])
    planned_controls = by_hand.planned_controls
    monkeypatch.setattr(
        by_hand, "planned_controls", lambda *args: planned_controls(*args)
    )  # another function for the compiler
    check = by_hand.line_by_line_check(jax.random.key(KEY))
    assert check.value > 1e4 * check.high


def test_the_grids_expectations_are_those_of_the_closed_forms(x64):
    problem = by_hand.moving_problem()
    cov = by_hand.HAND_COV
    exact = [
        risk_sensitive(problem, jnp.asarray(m), jnp.asarray(cov), by_hand.HAND_THETA)
        for m in by_hand.HAND_STARTS
    ]
    np.testing.assert_allclose(
        by_hand.risk_by_hand(problem, by_hand.HAND_STARTS.T, cov), exact, rtol=1e-12
    )
