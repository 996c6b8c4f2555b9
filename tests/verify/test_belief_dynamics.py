"""The certificate of (5)(6): it holds, and each of its parts fails where the statement is broken."""

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
from mppi_belief.verify import kushner
from mppi_belief.verify.certificates import belief_dynamics as dynamics
from mppi_belief.verify.kushner import Moments
from mppi_belief.verify.scalar_paths import HELD, controls_of, filtered


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


kushner_channel, kushner_observe = kushner.diffusion_channel, kushner.observe


def not_ito(on, p, c, R_o, dy, dt):
    """Without the correction -c^2 dt / 2 R_o."""
    return kushner_observe(on, p, c, R_o, dy, 0.0)


@pytest.mark.parametrize("broken", [uncentred, unnormalised_gain])
def test_a_diffusion_channel_that_is_not_6b_is_seen(broken, monkeypatch, quick_x64):
    monkeypatch.setattr(kushner, "diffusion_channel", broken)
    assert not dynamics.channel_check().holds
    assert not dynamics.step_orders()[1].holds


def test_a_control_that_does_not_act_through_its_divergence_is_seen(monkeypatch, quick_x64):
    generator = kushner.generator
    monkeypatch.setattr(kushner, "generator", lambda on, model, u: generator(on, model, 0.0))
    assert not dynamics.channel_check().holds
    assert not dynamics.step_orders()[0].holds
    assert not dynamics.space_orders()[0].holds


def test_a_drift_that_is_not_6a_in_both_the_channel_and_the_step_is_seen(monkeypatch, quick_x64):
    generator = kushner.generator
    monkeypatch.setattr(
        kushner, "generator", lambda on, model, u: generator(on, model._replace(f=0 * model.f), u)
    )
    assert not dynamics.step_orders()[0].holds


def test_bayes_rule_without_its_ito_term_is_seen(monkeypatch, quick_x64):
    monkeypatch.setattr(kushner, "observe", not_ito)
    assert not dynamics.step_orders()[0].holds
    assert not any(check.holds for check in dynamics.space_orders())


def test_another_gain_than_kalman_bucys_is_seen(monkeypatch, quick_x64):
    exact = dynamics.kalman_bucy_path
    wrong = {"mean": 1.02, "variance": 1.02}

    def scaled(problem: mb.Problem, dy: np.ndarray) -> Moments:
        found = exact(problem, dy)
        return Moments(found.mean * wrong["mean"], found.variance * wrong["variance"])

    for name, number in (("LINEAR_PATHS", 16), ("FINE", 1024), ("kalman_bucy_path", scaled)):
        monkeypatch.setattr(dynamics, name, number)
    assert not any(check.holds for check in dynamics.time_orders(0))


def test_the_kalman_bucy_path_is_an_integrators(quick_x64):
    """Increments that arrive evenly within each step make it an ordinary differential equation."""
    dy = np.random.default_rng(0).normal(size=(HELD, 2)) * 0.2
    errors = []
    for finer in (8, 16):
        problem = dynamics.linear(dynamics.A, 2.0, HELD * finer)
        found = dynamics.kalman_bucy_path(problem, np.repeat(dy, finer, axis=0) / finer)
        errors.append(np.abs(found.mean[-1] - integrated(dy, 2.0 / HELD)).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)


def integrated(dy: np.ndarray, dt: float) -> np.ndarray:
    A, B, C, R_o = dynamics.A, dynamics.B, dynamics.C, dynamics.SIGMA_O**2
    state = np.array([dynamics.PRIOR_MEAN, dynamics.PRIOR_MEAN, dynamics.PRIOR_STD**2])
    for u, increment in zip(controls_of(HELD), dy, strict=True):

        def rate(
            _: float, s: np.ndarray, u: float = u, increment: np.ndarray = increment
        ) -> np.ndarray:
            K = s[2] * C / R_o
            means = A * s[:2] + B * u + K * (increment / dt - C * s[:2])
            return np.append(means, 2 * A * s[2] + dynamics.SIGMA_W**2 - K**2 * R_o)

        state = reference._integrate(rate, state, dt)
    return state[:2]


CURVED = np.array(dynamics.CURVATURES)[:, None, None]
SHAPE = (len(CURVED), dynamics.PATHS, dynamics.STEPS + 1)


def made_up(error: Callable[[np.ndarray], np.ndarray]) -> list[Check]:
    """The checks of an extended Kalman filter whose mean and variance err by `error` of kappa."""
    exact = Moments(np.zeros(SHAPE), np.ones(SHAPE))
    found = Moments(*(part + error(CURVED) * np.ones(SHAPE) for part in exact))
    return dynamics.ekf_checks(found, exact, Moments(*np.full((2, *SHAPE), 1e-5)))


def test_another_order_in_the_curvature_is_seen():
    assert all(check.holds for check in made_up(lambda kappa: 0.1 * kappa * (1 - kappa)))
    assert [check.holds for check in made_up(lambda kappa: 0.1 * kappa**2)] == [False, False, True]
    assert [check.holds for check in made_up(lambda kappa: 1e-7 * kappa * (1 - kappa))] == [
        True,
        True,
        False,
    ]


def test_a_particle_filter_that_is_off_is_seen():
    rng, exact = np.random.default_rng(0), Moments(np.zeros(SHAPE), np.ones(SHAPE))
    own = Moments(*np.full((2, *SHAPE), 1e-5))
    for bias, holds in ((0.0, True), (0.1, False)):
        noise = rng.normal(size=(2, len(dynamics.SAMPLED), *SHAPE[1:2], 1)) * 0.05
        sampled = Moments(noise[0] + bias, 1 + noise[1])
        assert dynamics.particle_check(sampled, exact, own).holds == holds


def test_weights_of_another_measurement_noise_are_seen(monkeypatch, x64):
    cov = particle.measurement_cov
    monkeypatch.setattr(particle, "measurement_cov", lambda *at: 1.1 * cov(*at))
    for name, chosen in (("CURVATURES", (0.4,)), ("SAMPLED", [0]), ("ekf_checks", lambda *_: [])):
        monkeypatch.setattr(dynamics, name, chosen)
    (check,), _ = dynamics.curved_case(0)
    assert "particle filter" in check.computed
    assert not check.holds


def test_from_where_the_extended_kalman_filter_is_worse():
    def panel(*errors):
        kappa, none = [0.1, 0.2, 0.4], Line("", [], [])
        return Panel(
            "",
            "",
            "",
            [Line("EKF", kappa, errors), none, Line("particles", kappa, [1.0] * 3), none],
        )

    assert dynamics.worse_from(panel(0.5, 1.5, 2.0)) == 0.2
    assert dynamics.worse_from(panel(1.5, 0.5, 2.0)) == 0.4
    assert dynamics.worse_from(panel(1.5, 1.6, 2.0)) == 0.1
    assert dynamics.worse_from(panel(0.1, 0.2, 0.3)) == np.inf


def test_the_extended_kalman_filter_is_the_plain_one_on_a_curved_measurement(x64):
    problem, y = dynamics.curved(0.8), 0.5 + np.sin(np.arange(dynamics.STEPS))[:, None]
    mean, variance = quick_jit(lambda y: filtered(problem, mb.EKF(), y, jnp.zeros(2, jnp.uint32)))(
        jnp.asarray(y)
    )
    at, cov, dt = np.array([dynamics.PRIOR_MEAN]), np.array([[dynamics.PRIOR_STD**2]]), problem.dt
    noise = np.array([[0.3**2 / dt]])
    for k, u in enumerate(controls_of(dynamics.STEPS)):
        at, cov = reference.kalman_step(
            at,
            cov,
            y[k],
            lambda x, u=u: x + u * dt,
            lambda x: x + 0.4 * x**2,
            np.array([[0.5**2 * dt]]),
            lambda x: noise,
        )
        np.testing.assert_allclose([mean[k + 1], variance[k + 1]], [at[0], cov[0, 0]], rtol=1e-8)
