"""Tests NEES and NIS: their definitions, exact filters, and filters that are too sure."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb
import reference
from helpers import Feedback, assert_mean, float64, light_dark_problem, quick_jit
from mppi_belief.numerics.square_root import mahalanobis_squared
from system_helpers import pendulum

TRIALS = 200
STEPS = 25
DT = 0.1


def problem_of(curvature: float) -> mb.Problem:
    """Returns a pendulum at rest near the flat part of its sine, with little measurement noise."""
    cost = mb.GoalObstacleCost([0, 0], [1, 1], [1, 1], [1])
    system = pendulum(curvature=curvature, sensor_noise=0.02, gravity=0.0)
    start = {"prior_mean": [1.2, 0.0], "prior_std": [0.3, 0.1]}
    return mb.Problem(system, cost, **start, dt=DT, steps=STEPS, position=[0])


@quick_jit
def run(
    problem: mb.Problem, filter: mb.Filter, gain: float, numbers: jax.Array
) -> tuple[mb.Trial, mb.Consistency]:
    """Returns trials (N,) and what they say of the filter."""

    def run_one(number: jax.Array) -> tuple[mb.Trial, mb.Consistency]:
        trial = mb.simulate_trial(problem, filter, Feedback(gain), 1, number)
        return trial, mb.consistency(problem, filter, trial)

    return jax.vmap(run_one)(numbers)


@pytest.fixture(scope="module")
def linear() -> tuple[mb.Problem, mb.Trial, mb.Consistency]:
    """Returns trials in which the filter is exact: a double integrator with constant noise."""
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
    _, trial, errors = linear
    model = reference.light_dark(sampled=True, dt=DT, slope=0.0, floor=0.4)
    F = np.eye(4) + model.A * DT
    for i in range(3):
        nees = []
        nis = []
        for k in range(STEPS):
            mean = trial.beliefs.mean[i, k]
            cov = trial.beliefs.cov[i, k]
            u = trial.controls[i, k]
            S = model.C @ (F @ cov @ F.T + model.Q * DT) @ model.C.T + 0.16 * np.eye(2)
            d = trial.measurements[i, k] - model.C @ (F @ mean + DT * model.B @ u)
            e = trial.states[i, k + 1] - trial.beliefs.mean[i, k + 1]
            nees.append(e @ np.linalg.inv(trial.beliefs.cov[i, k + 1]) @ e)
            nis.append(d @ np.linalg.inv(S) @ d)
        np.testing.assert_allclose(
            [errors.nees[i], errors.nis[i]], [np.mean(nees), np.mean(nis)], rtol=1e-8
        )


def test_they_are_nx_and_ny_where_the_filter_is_exact(linear):
    assert_mean(linear[2].nees, 4)
    assert_mean(linear[2].nis, 2)


def test_both_are_too_large_for_a_filter_that_is_too_sure(linear):
    problem, trial, _ = linear

    @jax.vmap
    def halve(trial: mb.Trial) -> mb.Consistency:
        beliefs = trial.beliefs._replace(cov=trial.beliefs.cov / 2)
        return mb.consistency(problem, mb.EKF(), trial._replace(beliefs=beliefs))

    with float64():
        errors = quick_jit(halve)(trial)
    for values, freedom in ((errors.nees, 4), (errors.nis, 2)):
        with pytest.raises(AssertionError):
            assert_mean(values, freedom)


def test_the_filters_differ_for_a_curved_sensor_and_agree_for_an_affine_one(x64):
    """Compares the filters near the flat part, where one side of it looks like the other.

    Both are far too sure there. The unscented filter, which treats the curvature as noise, is so
    less, and it takes its own innovations.
    """
    numbers = jnp.arange(100)
    curved, affine = (
        {
            type(filter).__name__: run(problem_of(kappa), filter, 0.0, numbers)[1]
            for filter in (mb.EKF(), mb.UKF())
        }
        for kappa in (1.0, 0.0)
    )
    np.testing.assert_allclose(affine["EKF"].nis, affine["UKF"].nis, rtol=1e-6)
    assert_mean(affine["EKF"].nees, 2)
    assert_mean(affine["EKF"].nis, 1)
    ekf, ukf = (np.mean(curved[name].nees) for name in ("EKF", "UKF"))
    assert ekf > ukf > 10
    assert np.mean(curved["EKF"].nis) > np.mean(curved["UKF"].nis)
    by_default = quick_jit(jax.vmap(lambda trial: mb.consistency(problem_of(1.0), mb.EKF(), trial)))
    trial, own = run(problem_of(1.0), mb.UKF(), 0.0, numbers)
    assert np.abs(by_default(trial).nis - own.nis).max() > 0.1


def test_a_particle_belief_has_both(x64):
    errors = run(problem_of(0.0), mb.ParticleFilter(400), 0.0, jnp.arange(20))[1]
    assert np.all(np.isfinite(errors.nees))
    assert abs(np.mean(errors.nees) - 2) < 1
    assert abs(np.mean(errors.nis) - 1) < 0.3


@pytest.mark.parametrize(
    ("variances", "singular"), [([1e-12, 1.0], False), ([0.0, 1.0], True), ([1.0, 0.0], True)]
)
def test_a_singular_covariance_has_no_distance_whatever_the_units(variances, singular):
    deviations = jnp.sqrt(jnp.array([1e-12, 1.0]))
    distance = mahalanobis_squared(deviations, jnp.diag(jnp.array(variances)))
    assert jnp.isnan(distance) if singular else distance == pytest.approx(2.0)
    assert jnp.isnan(mahalanobis_squared(jnp.ones(2), jnp.ones((2, 2))))


def test_steps_without_a_distance_are_left_out(linear):
    """Gives nan where all steps are left out."""
    problem, trials, errors = linear
    trial = jax.tree.map(lambda part: part[0], trials)
    covs = trial.beliefs.cov.copy()
    covs[3] = 0.0

    @quick_jit
    def judge(covs: jax.Array) -> mb.Consistency:
        beliefs = trial.beliefs._replace(cov=covs)
        return mb.consistency(problem, mb.EKF(), trial._replace(beliefs=beliefs))

    with float64():
        without_one = judge(covs)
        without_all = judge(np.zeros_like(covs))
    e = trial.states[3] - trial.beliefs.mean[3]
    left_out = e @ np.linalg.inv(trial.beliefs.cov[3]) @ e
    expected = (STEPS * errors.nees[0] - left_out) / (STEPS - 1)
    np.testing.assert_allclose(without_one.nees, expected)
    assert np.isnan(without_all.nees)
    assert np.isfinite(without_all.nis)  # since the measurement noise remains
