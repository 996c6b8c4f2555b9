"""The certificate of (5)(6): it holds, and its parts fail where the statement is broken."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb
import reference
from certificate_helpers import assert_holds
from helpers import float64, quick_jit
from mppi_belief.filters import particle
from mppi_belief.results.certificate import Certificate, Check, Line, Panel
from mppi_belief.verify.certificates import belief_dynamics as dynamics
from mppi_belief.verify.scenarios import belief_channels as channels
from mppi_belief.verify.scenarios import curved_measurement as curved
from mppi_belief.verify.scenarios import linear_filtering as linear
from mppi_belief.verify.scenarios.scalar_paths import (
    CONTROL_PIECES,
    PRIOR_MEAN,
    PRIOR_STD,
    cosine_controls,
    filter_moments,
)
from mppi_belief.verify.solvers import kushner
from mppi_belief.verify.solvers.kushner import Moments


@pytest.fixture(scope="module")
def certificate() -> Certificate:
    with float64():
        return dynamics.certify()


def test_it_holds(certificate):
    assert_holds(certificate)


def test_the_extended_kalman_filter_errs_more_the_more_the_measurement_is_curved(certificate):
    mean, std, *particles = certificate.panels[0].lines
    assert np.all(np.diff(mean.y) > 0)
    assert np.all(np.diff(std.y) > 0)
    assert max(max(line.y) for line in particles) < mean.y[-1]


def uncentred(on, p, c, R_o):
    return p * c / R_o


def unnormalised_gain(on, p, c, R_o):
    return 2 * kushner_channel(on, p, c, R_o)


kushner_channel = kushner.diffusion_channel
kushner_observe = kushner.observe


def not_ito(on, p, c, R_o, dy, dt):
    """Apply Bayes' rule without the correction -c^2 dt / 2 R_o."""
    return kushner_observe(on, p, c, R_o, dy, 0.0)


@pytest.mark.parametrize("broken", [uncentred, unnormalised_gain])
def test_a_diffusion_channel_that_is_not_6b_is_seen(broken, monkeypatch, quick_x64):
    monkeypatch.setattr(kushner, "diffusion_channel", broken)
    assert not channels.channel_check().holds
    assert not channels.step_order_checks()[1].holds


def test_a_control_that_does_not_act_through_its_divergence_is_seen(monkeypatch, quick_x64):
    generator = kushner.fokker_planck_bands
    monkeypatch.setattr(
        kushner, "fokker_planck_bands", lambda grid, model, u: generator(grid, model, 0.0)
    )
    assert not channels.channel_check().holds
    assert not channels.step_order_checks()[0].holds
    assert not linear.space_order_checks()[0].holds


def test_a_drift_that_is_not_6a_in_both_the_channel_and_the_step_is_seen(monkeypatch, quick_x64):
    generator = kushner.fokker_planck_bands
    monkeypatch.setattr(
        kushner,
        "fokker_planck_bands",
        lambda grid, model, u: generator(grid, model._replace(f=0 * model.f), u),
    )
    assert not channels.step_order_checks()[0].holds


def test_bayes_rule_without_its_ito_term_is_seen(monkeypatch, quick_x64):
    monkeypatch.setattr(kushner, "observe", not_ito)
    assert not channels.step_order_checks()[0].holds
    assert not any(check.holds for check in linear.space_order_checks())


def test_another_gain_than_kalman_bucys_is_seen(monkeypatch, quick_x64):
    exact = linear.kalman_bucy_moments
    wrong = {"mean": 1.02, "variance": 1.02}

    def scaled(problem: mb.Problem, dy: np.ndarray) -> Moments:
        moments = exact(problem, dy)
        return Moments(moments.mean * wrong["mean"], moments.variance * wrong["variance"])

    for name, number in (
        ("LINEAR_PATHS", 16),
        ("FINE_STEPS", 1024),
        ("kalman_bucy_moments", scaled),
    ):
        monkeypatch.setattr(linear, name, number)
    assert not any(check.holds for check in linear.time_order_checks(0))


def test_the_kalman_bucy_path_is_an_integrators(quick_x64):
    """Integrate the equation, which is ordinary if increments arrive evenly in each step."""
    dy = np.random.default_rng(0).normal(size=(CONTROL_PIECES, 2)) * 0.2
    errors = []
    for finer in (8, 16):
        problem = linear.linear_problem(linear.LINE_A, 2.0, CONTROL_PIECES * finer)
        moments = linear.kalman_bucy_moments(problem, np.repeat(dy, finer, axis=0) / finer)
        errors.append(np.abs(moments.mean[-1] - integrated(dy, 2.0 / CONTROL_PIECES)).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)


def integrated(dy: np.ndarray, dt: float) -> np.ndarray:
    A = linear.LINE_A
    B = linear.LINE_B
    C = linear.LINE_C
    R_o = linear.SIGMA_O**2
    state = np.array([PRIOR_MEAN, PRIOR_MEAN, PRIOR_STD**2])
    for u, increment in zip(cosine_controls(CONTROL_PIECES), dy, strict=True):

        def rate(
            _: float, s: np.ndarray, u: float = u, increment: np.ndarray = increment
        ) -> np.ndarray:
            K = s[2] * C / R_o
            means = A * s[:2] + B * u + K * (increment / dt - C * s[:2])
            return np.append(means, 2 * A * s[2] + linear.SIGMA_W**2 - K**2 * R_o)

        state = reference.integrate(rate, state, dt)
    return state[:2]


CURVED = np.array(curved.CURVATURES)[:, None, None]
SHAPE = (len(CURVED), curved.CURVED_PATHS, curved.CURVED_STEPS + 1)


def checks_of_errors(error: Callable[[np.ndarray], np.ndarray]) -> list[Check]:
    """Return the checks of an EKF whose mean and variance err by `error` of kappa."""
    exact = Moments(np.zeros(SHAPE), np.ones(SHAPE))
    approximate = Moments(*(part + error(CURVED) * np.ones(SHAPE) for part in exact))
    return curved.ekf_checks(approximate, exact, Moments(*np.full((2, *SHAPE), 1e-5)))


def test_another_order_in_the_curvature_is_seen():
    assert all(check.holds for check in checks_of_errors(lambda kappa: 0.1 * kappa * (1 - kappa)))
    assert [check.holds for check in checks_of_errors(lambda kappa: 0.1 * kappa**2)] == [
        False,
        False,
        True,
    ]
    assert [
        check.holds for check in checks_of_errors(lambda kappa: 1e-7 * kappa * (1 - kappa))
    ] == [
        True,
        True,
        False,
    ]


def test_a_particle_filter_that_is_off_is_seen():
    rng = np.random.default_rng(0)
    exact = Moments(np.zeros(SHAPE), np.ones(SHAPE))
    own = Moments(*np.full((2, *SHAPE), 1e-5))
    for bias, holds in ((0.0, True), (0.1, False)):
        noise = rng.normal(size=(2, len(curved.PARTICLE_CURVATURES), *SHAPE[1:2], 1)) * 0.05
        sampled = Moments(noise[0] + bias, 1 + noise[1])
        assert (
            curved.particle_check(curved.CurvedResults(exact, sampled, exact, own)).holds == holds
        )


def test_weights_of_another_measurement_noise_are_seen(monkeypatch, x64):
    cov = particle.measurement_cov
    monkeypatch.setattr(particle, "measurement_cov", lambda *arguments: 1.1 * cov(*arguments))
    monkeypatch.setattr(curved, "CURVATURES", (0.4,))
    monkeypatch.setattr(curved, "PARTICLE_CURVATURES", [0])
    check = curved.particle_check(curved.curved_results(0))
    assert "particle filter" in check.computed
    assert not check.holds


def test_from_where_the_extended_kalman_filter_is_worse():
    def panel(*errors):
        kappa = [0.1, 0.2, 0.4]
        none = Line("", [], [])
        return Panel(
            "",
            "",
            "",
            [Line("EKF", kappa, errors), none, Line("particles", kappa, [1.0] * 3), none],
        )

    assert dynamics.least_curvature_where_ekf_is_worse(panel(0.5, 1.5, 2.0)) == 0.2
    assert dynamics.least_curvature_where_ekf_is_worse(panel(1.5, 0.5, 2.0)) == 0.4
    assert dynamics.least_curvature_where_ekf_is_worse(panel(1.5, 1.6, 2.0)) == 0.1
    assert dynamics.least_curvature_where_ekf_is_worse(panel(0.1, 0.2, 0.3)) == np.inf


def test_the_extended_kalman_filter_is_the_plain_one_on_a_curved_measurement(x64):
    problem = curved.curved_problem(0.8)
    y = 0.5 + np.sin(np.arange(curved.CURVED_STEPS))[:, None]
    mean, variance = quick_jit(
        lambda y: filter_moments(problem, mb.EKF(), y, jnp.zeros(2, jnp.uint32))
    )(jnp.asarray(y))
    estimate = np.array([PRIOR_MEAN])
    cov = np.array([[PRIOR_STD**2]])
    dt = problem.dt
    noise = np.array([[0.3**2 / dt]])
    for k, u in enumerate(cosine_controls(curved.CURVED_STEPS)):
        estimate, cov = reference.kalman_step(
            estimate,
            cov,
            y[k],
            lambda x, u=u: x + u * dt,
            lambda x: x + 0.4 * x**2,
            np.array([[0.5**2 * dt]]),
            lambda x: noise,
        )
        np.testing.assert_allclose(
            [mean[k + 1], variance[k + 1]], [estimate[0], cov[0, 0]], rtol=1e-8
        )
