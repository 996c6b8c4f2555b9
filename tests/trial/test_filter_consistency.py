"""NEES and NIS: by their definition, as large as they should be where the filter is exact, and told where it is not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb
import reference
from helpers import Feedback, assert_mean, float64, light_dark_problem, quick_jit
from mppi_belief.numerics.square_root import mahalanobis_squared
from system_helpers import pendulum

TRIALS, STEPS, DT = 200, 25, 0.1


def problem_of(curvature: float) -> mb.Problem:
    """A pendulum at rest near the flat part of its sine, seen well."""
    cost = mb.GoalObstacleCost([0, 0], [1, 1], [1, 1], [1])
    system = pendulum(curvature=curvature, sensor_noise=0.02, gravity=0.0)
    return mb.Problem(system, cost, [1.2, 0.0], [0.3, 0.1], dt=DT, steps=STEPS)


@quick_jit
def run(
    problem: mb.Problem, filter: mb.Filter, gain: float, numbers: jax.Array
) -> tuple[mb.Trial, mb.Consistency]:
    """Trials (N,) and what they say of the filter."""

    def one(number: jax.Array) -> tuple[mb.Trial, mb.Consistency]:
        trial = mb.simulate_trial(problem, filter, Feedback(gain), 1, number)
        return trial, mb.consistency(problem, filter, trial)

    return jax.vmap(one)(numbers)


@pytest.fixture(scope="module")
def linear() -> tuple[mb.Problem, mb.Trial, mb.Consistency]:
    """Where the filter is exact: the double integrator with constant noise."""
    with float64():
        prior = {
            "prior_mean": [1, 1, 0, 0],
            "prior_std": [0.4, 0.3, 0.5, 0.2],
            "steps": STEPS,
            "dt": DT,
        }
        problem = light_dark_problem(system={"noise_slope": 0.0, "noise_floor": 0.4}, **prior)
        return problem, *jax.tree.map(np.asarray, run(problem, mb.EKF(), 0.5, jnp.arange(TRIALS)))


def test_they_are_their_definitions(linear):
    _, trial, found = linear
    model = reference.light_dark(sampled=True, dt=DT, slope=0.0, floor=0.4)
    F = np.eye(4) + model.A * DT
    for i in range(3):
        nees, nis = [], []
        for k in range(STEPS):
            mean, cov, u = trial.beliefs.mean[i, k], trial.beliefs.cov[i, k], trial.controls[i, k]
            S = model.C @ (F @ cov @ F.T + model.Q * DT) @ model.C.T + 0.16 * np.eye(2)
            d = trial.measurements[i, k] - model.C @ (F @ mean + DT * model.B @ u)
            e = trial.states[i, k + 1] - trial.beliefs.mean[i, k + 1]
            nees.append(e @ np.linalg.inv(trial.beliefs.cov[i, k + 1]) @ e)
            nis.append(d @ np.linalg.inv(S) @ d)
        np.testing.assert_allclose(
            [found.nees[i], found.nis[i]], [np.mean(nees), np.mean(nis)], rtol=1e-8
        )


def test_they_are_nx_and_ny_where_the_filter_is_exact(linear):
    assert_mean(linear[2].nees, 4)
    assert_mean(linear[2].nis, 2)


def test_a_filter_that_believes_itself_too_much_is_told_by_both(linear):
    problem, trial, _ = linear

    @jax.vmap
    def half(one: mb.Trial) -> mb.Consistency:
        return mb.consistency(
            problem, mb.EKF(), one._replace(beliefs=one.beliefs._replace(cov=one.beliefs.cov / 2))
        )

    with float64():
        found = quick_jit(half)(trial)
    for values, freedom in ((found.nees, 4), (found.nis, 2)):
        with pytest.raises(AssertionError):
            assert_mean(values, freedom)


def test_the_filters_differ_where_the_sensor_bends_and_agree_where_it_does_not(x64):
    """Near the flat part either is far too sure, one side of it looking like the other; the unscented one, which takes
    the bend for noise, less, and it forecasts by itself."""
    numbers = jnp.arange(100)
    bent, straight = (
        {
            type(filter).__name__: run(problem_of(kappa), filter, 0.0, numbers)[1]
            for filter in (mb.EKF(), mb.UKF())
        }
        for kappa in (1.0, 0.0)
    )
    np.testing.assert_allclose(straight["EKF"].nis, straight["UKF"].nis, rtol=1e-6)
    assert_mean(straight["EKF"].nees, 2)
    assert_mean(straight["EKF"].nis, 1)
    ekf, ukf = (np.mean(bent[name].nees) for name in ("EKF", "UKF"))
    assert ekf > ukf > 10
    assert np.mean(bent["EKF"].nis) > np.mean(bent["UKF"].nis)
    by_default = quick_jit(jax.vmap(lambda one: mb.consistency(problem_of(1.0), mb.EKF(), one)))
    trial, own = run(problem_of(1.0), mb.UKF(), 0.0, numbers)
    assert np.abs(by_default(trial).nis - own.nis).max() > 0.1


def test_a_particle_belief_has_both(x64):
    found = run(problem_of(0.0), mb.ParticleFilter(400), 0.0, jnp.arange(20))[1]
    assert np.all(np.isfinite(found.nees))
    assert abs(np.mean(found.nees) - 2) < 1
    assert abs(np.mean(found.nis) - 1) < 0.3


@pytest.mark.parametrize(
    ("variances", "singular"), [([1e-12, 1.0], False), ([0.0, 1.0], True), ([1.0, 0.0], True)]
)
def test_a_singular_covariance_has_no_distance_whatever_the_units(variances, singular):
    found = mahalanobis_squared(jnp.sqrt(jnp.array([1e-12, 1.0])), jnp.diag(jnp.array(variances)))
    assert jnp.isnan(found) if singular else found == pytest.approx(2.0)
    assert jnp.isnan(mahalanobis_squared(jnp.ones(2), jnp.ones((2, 2))))


def test_steps_without_a_distance_are_left_out(linear):
    """Nan where that is all of them."""
    problem, trial, found = linear
    one = jax.tree.map(lambda part: part[0], trial)
    covs = one.beliefs.cov.copy()
    covs[3] = 0.0
    with float64():
        judge = quick_jit(
            lambda cov: mb.consistency(
                problem, mb.EKF(), one._replace(beliefs=one.beliefs._replace(cov=cov))
            )
        )
        some, none = judge(covs), judge(np.zeros_like(covs))
    e = one.states[3] - one.beliefs.mean[3]
    left_out = e @ np.linalg.inv(one.beliefs.cov[3]) @ e
    np.testing.assert_allclose(some.nees, (STEPS * found.nees[0] - left_out) / (STEPS - 1))
    assert np.isnan(none.nees)
    assert np.isfinite(none.nis)  # the noise is left
