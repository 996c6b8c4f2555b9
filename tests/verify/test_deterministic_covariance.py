"""Proposition 2: its certificate holds, and each part fails where the proposition is broken."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mppi_belief as mb
import reference
from certificate_helpers import assert_holds
from helpers import float64, quick_jit, random_spd, riccati_step
from mppi_belief.belief import schedule as schedules
from mppi_belief.belief.schedule import gain_schedule
from mppi_belief.problem import Belief
from mppi_belief.results.certificate import Certificate
from mppi_belief.systems import LightDark
from mppi_belief.verify.certificates import deterministic_covariance as covariance
from mppi_belief.verify.scenarios import linear_covariance as model
from mppi_belief.verify.scenarios.covariance_limits import short_step_results
from mppi_belief.verify.scenarios.covariance_steps import per_step_checks, settled_checks

schedule = quick_jit(gain_schedule, static_argnames="method")


@pytest.fixture(scope="module")
def certificate() -> Certificate:
    with float64():
        return covariance.certify()


def test_it_holds(certificate):
    assert_holds(certificate)


def test_the_reference_is_the_riccati_equations(x64):
    integrated = model.integrated_reference()
    cov = np.diag(np.square([0.5, 0.4, 0.3]))
    exact = reference.riccati_flow(
        cov, model.WIND_A, model.WIND_Q, model.WIND_C, model.WIND_R_O, model.WIND_DURATION
    )
    assert np.linalg.norm(integrated.cov - exact) < integrated.error
    np.testing.assert_allclose(
        integrated.gain, exact @ model.WIND_C.T @ np.linalg.inv(model.WIND_R_O), atol=1e-9
    )
    np.testing.assert_allclose(
        integrated.diffusion, integrated.gain @ model.WIND_R_O @ integrated.gain.T, atol=1e-12
    )


def test_another_process_noise_than_the_filters_is_seen(monkeypatch, quick_x64):
    monkeypatch.setattr(model, "WIND_Q", 1.01 * model.WIND_Q)
    assert not any(check.holds for check in short_step_results(schedule)[0][1:])
    assert not any(check.holds for check in settled_checks(schedule))


@pytest.mark.parametrize("part", ["cov", "gain", "diffusion"])
def test_a_wrong_limit_is_seen(part, quick_x64):
    def wrong(*arguments):
        computed = schedule(*arguments)
        return computed._replace(**{part: getattr(computed, part) * 1.001})

    assert not short_step_results(wrong)[0][1].holds


def test_the_diffusion_of_the_measurement_noise_alone_is_seen(monkeypatch, quick_x64):
    """Put K R_s K' in place of K S K', which is the same in the limit."""

    def wrong(problem, mean, root, u):
        mean, root, K, _ = filter_step(problem, mean, root, u)
        return mean, root, K, K @ (model.WIND_R_O / problem.dt) @ K.T / problem.dt

    filter_step = schedules.filter_step
    monkeypatch.setattr(schedules, "filter_step", wrong)
    assert [check.holds for check in per_step_checks(gain_schedule)] == [False, True]


@pytest.mark.parametrize("part", ["gain", "diffusion"])
def test_a_riccati_schedule_that_is_a_step_late_is_seen(part, quick_x64):
    """Take K or D of t_{k+1} instead of t_k, which is the same once all is settled."""

    def late(problem, start, controls, method):
        schedule = gain_schedule(problem, start, controls, method)
        if method != "riccati":
            return schedule
        next_belief = Belief(schedule.mean[1], schedule.cov[1])
        next_schedule = gain_schedule(problem, next_belief, controls, method)
        return schedule._replace(**{part: getattr(next_schedule, part)})

    assert [check.holds for check in per_step_checks(late)] == [True, False]


def test_an_ekf_that_is_not_numpys_recursion_is_seen(monkeypatch, quick_x64):
    monkeypatch.setattr(model, "WIND_Q", (1 + 1e-9) * model.WIND_Q)
    checks = covariance.independence_checks(model.linear_wind_problem(0.1), 0)
    assert [check.holds for check in checks] == [True, False]


def test_a_covariance_that_feels_the_controls_is_seen(monkeypatch, quick_x64):
    def controlled(problem, start, controls, *rest):
        schedule = gain_schedule(problem, start, controls, *rest)
        return schedule._replace(cov=schedule.cov * (1 + 1e-15 * jnp.sum(controls**2)))

    monkeypatch.setattr(covariance, "gain_schedule", controlled)
    assert not covariance.independence_checks(model.linear_wind_problem(0.1), 0)[0].holds


def test_a_filter_whose_covariance_feels_the_measurements_is_seen(monkeypatch, quick_x64):
    @mb.struct
    class Doubting(covariance.EKF):
        def update(self, problem, belief, u, y, key):
            after = super().update(problem, belief, u, y, key)
            return after._replace(root=after.root * (1 + 1e-6 * jnp.sum(y**2)))

    monkeypatch.setattr(covariance, "EKF", Doubting)
    assert not any(
        check.holds for check in covariance.independence_checks(model.linear_wind_problem(0.1), 0)
    )


def test_light_that_is_the_same_everywhere_is_seen(monkeypatch, quick_x64):
    def even(dt):
        system = LightDark(0.3, 5.0, 0.0, 0.1)
        return light_dark(dt).__class__(**{**vars(light_dark(dt)), "system": system})

    light_dark = covariance.state_dependent_problem
    monkeypatch.setattr(covariance, "state_dependent_problem", even)
    assert not covariance.dependence_check(0).holds


def test_bits_are_counted():
    parts = np.ones((3, 2, 2))
    assert model.differing_entries(parts) == 0
    parts[2, 0, 1] += 1e-15
    assert model.differing_entries(parts) == 1


@settings(max_examples=25, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6), duration=st.floats(0.01, 3), relative=st.floats(0.01, 0.9))
def test_the_flow_lets_no_relative_error_grow(seed, duration, relative):
    """Check the basis of all bands: (1 ± e) Sigma flows to between (1 ± e) times the flow."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(3, 3))
    C = rng.normal(size=(2, 3))
    cov = random_spd(rng, 3, 0.05)
    Q = random_spd(rng, 3, 0.01)
    R_o = random_spd(rng, 2, 0.1)
    with float64():
        after, more, less = (
            np.asarray(riccati_step(jnp.asarray(cov * factor), A, Q, C, R_o, duration))
            for factor in (1.0, 1 + relative, 1 - relative)
        )
    tiny = 1e-10 * np.linalg.norm(after)
    assert np.linalg.eigvalsh((1 + relative) * after - more).min() > -tiny
    assert np.linalg.eigvalsh(less - (1 - relative) * after).min() > -tiny
