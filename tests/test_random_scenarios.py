"""A few of the scenarios of `random_scenarios.py`, and what it found, one deterministic test
each.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb
import random_scenarios
from helpers import Feedback, float64, light_dark_problem, quick_jit, riccati_step
from mppi_belief.belief import gaussian as gaussians
from mppi_belief.belief import kalman as belief
from mppi_belief.numerics.square_root import ldl_solve, pivoted_cholesky, tria
from mppi_belief.planning import path_weights as pw
from mppi_belief.trial.trials import divergence

TINY = float(np.finfo(np.float32).eps)


@pytest.mark.parametrize(
    ("system", "method"),
    [("light_dark", "belief"), ("light_dark", "belief, laplace"), ("linear_3_2_2", "algorithm_1")],
)
def test_covariances_weights_and_controls_hold_in_random_scenarios(system, method):
    (_, _, actual), *_ = random_scenarios.studied(system, 120, 1, [method], "float32")
    bad = {
        name: np.flatnonzero(wrong)
        for name, wrong in random_scenarios.violations(actual, "float32").items()
    }
    assert all(len(scenarios) == 0 for scenarios in bad.values()), bad
    messages = [
        divergence(*jax.tree.map(lambda a, i=i: a[i], (actual.metrics, actual.trial)))
        for i in range(120)
    ]
    names = random_scenarios.lost(actual)
    assert [text is not None for text in messages] == (names != "").tolist()
    assert np.all(np.isfinite(actual.trial.controls[names == ""]))
    # of the light-dark vehicle no scenario is impossible, of random systems the violently unstable
    # are
    assert np.mean(names == "") == 1 if system == "light_dark" else 0.5 < np.mean(names == "") < 1


def test_two_measurements_of_a_rank_one_belief_a_million_times_their_noise_in_float32():
    """Inverting S, which is singular to rounding, made the covariance indefinite."""
    root = 1e3 * np.array([1.0, 0.7, -0.4])
    C = np.array([[1.0, 0.3, 0.2], [0.9, 0.4, 0.1]])
    noise = np.array([1.0, 0.5])
    with float64():
        exact = 1 / (1 / 1 + np.sum((C @ root / noise) ** 2))
    cov = jnp.asarray(np.outer(root, root), jnp.float32)
    after, K, moves = quick_jit(belief.potter_update)(
        pivoted_cholesky(cov), jnp.asarray(C), jnp.diag(noise**2)
    )
    actual = np.asarray(gaussians.covariance(after), float)
    values = np.linalg.eigvalsh(actual)
    assert values[0] >= -9 * TINY * values[-1]
    np.testing.assert_allclose(actual, exact * np.outer(root, root), rtol=1e-3)
    np.testing.assert_allclose(np.asarray(moves @ moves.T, float), np.outer(root, root), rtol=1e-5)
    assert np.all(np.isfinite(K))


def test_a_step_that_takes_a_large_variance_away_keeps_the_small_one_beside_it():
    """F = [[1, -1], [0, 1]] on perfectly correlated states: F Sigma F' itself has only rounding
    left of its first.
    """
    small = 1e-3
    root = np.array([[1.0, small], [1.0, 0.0]], np.float32) * 1e3
    after = np.asarray(tria(jnp.array([[1.0, -1.0], [0.0, 1.0]]) @ root), float)
    np.testing.assert_allclose(
        after @ after.T, [[(1e3 * small) ** 2, 0], [0, 1e6]], rtol=1e-6, atol=1
    )


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("rank", [0, 1, 2, 3, 4])
def test_roots_of_semidefinite_matrices_in_any_units(scale, rank, rng):
    units = scale * 10 ** rng.uniform(-5, 5, 4)
    half = rng.normal(size=(4, rank)) * units[:, None]
    M = (half @ half.T).astype(np.float32)
    actual = np.asarray(pivoted_cholesky(jnp.asarray(M)), float)
    np.testing.assert_array_less(np.abs(actual @ actual.T - M) / np.outer(units, units), 1e-5)
    np.testing.assert_array_equal(actual[:, rank:], 0)
    L = np.asarray(tria(jnp.asarray(np.hstack([half, half]), jnp.float32)), float)
    np.testing.assert_array_less(np.abs(L @ L.T - 2 * M) / np.outer(units, units), 1e-5)
    np.testing.assert_array_equal(np.triu(L, 1), 0)


def test_the_root_of_a_matrix_with_a_hole_is_not_finite():
    """A belief that is not a number must not come out as one."""
    M = jnp.eye(3).at[1, 1].set(jnp.nan)
    assert not np.all(np.isfinite(pivoted_cholesky(M)))
    assert not np.all(np.isfinite(tria(M)))


def test_decorrelated_noise_is_diagonal(x64, rng):
    half = rng.normal(size=(4, 4))
    T, r = ldl_solve(jnp.eye(4), jnp.asarray(half @ half.T))
    M = rng.normal(size=(4, 3))
    np.testing.assert_allclose(
        ldl_solve(jnp.asarray(M), jnp.asarray(half @ half.T))[0], T @ M, atol=1e-11
    )
    np.testing.assert_allclose(T @ half @ half.T @ T.T, np.diag(np.array(r)), atol=1e-12)
    np.testing.assert_array_equal(np.triu(T), np.eye(4))
    np.testing.assert_allclose(np.prod(np.array(r)), np.linalg.det(half) ** 2, rtol=1e-10)


def test_a_riccati_step_keeps_slow_decay_beside_a_very_good_sensor_in_float32():
    """Doubled as often as the information needs it, 1 + A dt / 2^s used to round to 1: nothing
    decayed.
    """
    A = jnp.diag(jnp.array([0.0, -1.0]))
    zero = jnp.zeros((2, 2))
    C = jnp.array([[1.0, 0.0]])
    R_o = jnp.array([[1e-9]])
    actual = riccati_step(jnp.eye(2), A, zero, C, R_o, 1.0)
    np.testing.assert_allclose(np.diag(actual), [1e-9, np.exp(-2)], rtol=0.01)  # eps sqrt(1 / 1e-9)


def test_weights_where_costs_over_the_temperature_overflow():
    w = pw.weights(jnp.array([3e33, 2e33, 2e33], jnp.float32), 1e-6)
    np.testing.assert_array_equal(w, [0, 0.5, 0.5])


def test_a_step_without_one_finite_path_leaves_the_plan_alone_and_the_trial_says_so():
    problem = light_dark_problem(cost={"w_obs": 1e30}, steps=2)
    with jax.enable_x64(False):
        controller = mb.MPPI(8, 3, 1.0, mb.RiskSensitive(1e30), mb.NominalSampler(1.0))
        trial = quick_jit(lambda: mb.simulate_trial(problem, mb.EKF(), controller, 0, 0))()
        judged = quick_jit(mb.metrics)(problem, trial)
    np.testing.assert_array_equal(trial.controls, 0)
    assert (
        divergence(judged, trial)
        == "the cost of every sampled path of a step left the finite numbers"
    )


@pytest.mark.parametrize("part", ["mean", "cov", "controls", "none"])
def test_a_trial_whose_belief_or_control_is_lost_says_so(part):
    problem = light_dark_problem(steps=2)
    trial = jax.device_get(
        quick_jit(lambda: mb.simulate_trial(problem, mb.EKF(), Feedback(0.5), 0, 0))()
    )
    judged = quick_jit(mb.metrics)(problem, trial)
    hole = {name: np.full_like(values, np.nan) for name, values in trial.beliefs._asdict().items()}
    if part == "controls":
        trial = trial._replace(controls=hole["mean"][:-1, :2])
    elif part != "none":
        trial = trial._replace(beliefs=trial.beliefs._replace(**{part: hole[part]}))
    what = {"mean": "belief", "cov": "belief", "controls": "control"}.get(part)
    assert divergence(judged, trial) == (what and f"the {what} left the finite numbers")
