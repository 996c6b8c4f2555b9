"""The filter's covariance is that of its errors: chi-square tests over linear trials."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2

import mppi_belief as mb
import reference
from helpers import SIGMAS, Feedback, float64, light_dark_problem, quick_jit

TRIALS = 200
STEPS = 25
DT = 0.1
NOISE = 0.4
ALPHA = 1e-5  # two-sided, all intervals of a test together


@pytest.fixture(scope="module")
def trial() -> mb.Trial:
    """Returns trials (N,) with constant measurement noise, where the filter is exact."""
    with float64():
        system = {"noise_slope": 0.0, "noise_floor": NOISE}
        problem = light_dark_problem(
            system=system, prior_std=[0.4, 0.3, 0.5, 0.2], steps=STEPS, dt=DT
        )
        run = quick_jit(
            jax.vmap(lambda number: mb.simulate_trial(problem, mb.EKF(), Feedback(0.5), 1, number))
        )
        return jax.tree.map(np.asarray, run(jnp.arange(TRIALS)))


def squared(deviation: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """d' Sigma^-1 d over leading axes."""
    return np.einsum("...i,...i", deviation, np.linalg.solve(cov, deviation[..., None])[..., 0])


def assert_chi_square(total: np.ndarray, freedom: int, tests: int) -> None:
    low, high = chi2.ppf([ALPHA / 2 / tests, 1 - ALPHA / 2 / tests], freedom)
    assert np.all((total > low) & (total < high)), (total, low, high)


def test_estimation_errors_are_as_large_as_the_covariance_says(trial):
    """NEES: at every step, over all trials."""
    nees = squared(trial.states - trial.beliefs.mean, trial.beliefs.cov)
    assert_chi_square(nees.sum(axis=0), TRIALS * 4, STEPS + 1)


def test_innovations_are_white_and_as_large_as_predicted(trial):
    """NIS: innovations of different steps are independent, so all of them add up."""
    model = reference.light_dark(sampled=True, dt=DT, slope=0.0, floor=NOISE)
    F = np.eye(4) + model.A * DT
    predicted = trial.beliefs.mean[:, :-1] @ F.T + DT * trial.controls @ model.B.T
    S = model.C @ (
        F @ trial.beliefs.cov[:, :-1] @ F.T + model.Q * DT
    ) @ model.C.T + NOISE**2 * np.eye(2)
    innovations = trial.measurements - predicted @ model.C.T
    assert_chi_square(squared(innovations, S).sum(), TRIALS * STEPS * 2, 1)
    white = np.linalg.solve(np.linalg.cholesky(S), innovations[..., None])[..., 0]
    correlation = np.mean(white[:, 1:] * white[:, :-1])
    assert abs(correlation) < SIGMAS / np.sqrt(white[:, 1:].size)


def test_a_covariance_a_fifth_too_large_or_small_would_be_found_out(trial):
    """That the intervals above are narrow enough to tell."""
    nees = squared(trial.states - trial.beliefs.mean, trial.beliefs.cov)
    for factor in (0.8, 1.2):
        with pytest.raises(AssertionError):
            assert_chi_square(nees.sum(axis=0) / factor, TRIALS * 4, STEPS + 1)


def test_update_is_predict_then_correct(light_dark, x64):
    model = reference.light_dark(sampled=True, dt=DT)
    key = jax.random.key(0)
    u = np.array([1.0, -2.0])
    y = np.array([1.3, 0.8])
    before = mb.EKF().init(light_dark, key)
    after = quick_jit(mb.EKF().update)(light_dark, before, u, y, key)
    mean, cov = reference.kalman_step(
        np.asarray(before.mean),
        np.asarray(before.cov),
        y,
        lambda x: x + DT * (model.A @ x + model.B @ u),
        lambda x: model.C @ x,
        model.Q * DT,
        lambda x: model.intensity(x) / DT,
    )
    np.testing.assert_allclose(after.mean, mean, atol=1e-9)
    np.testing.assert_allclose(after.cov, cov, atol=1e-9)
