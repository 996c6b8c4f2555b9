"""Tests the cost of Sec. VII: its formulas, its moments together, and the limits of each."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mppi_belief as mb
import reference
from helpers import CENTERS, SIGMAS, light_dark_problem, quick_jit, random_spd
from mppi_belief.belief import cost as belief_cost
from mppi_belief.problem import ClosedFormCost, Cost

GOAL = np.array([7.0, 0.0, 0.0, 0.0])
QX = np.diag([1.5, 1.5, 0.6, 0.6])
QT = np.diag([5, 5, 0.15, 0.15])

running_moments = quick_jit(belief_cost.running_moments)


def penalty(x: np.ndarray, w_obs: float = 500.0) -> np.ndarray:
    return w_obs * reference.bumps(x, np.array(CENTERS), 0.285)


def test_base_penalty_and_terminal_by_their_formulas(light_dark, x64, rng):
    cost = light_dark.cost
    x = np.array([3, 0, 0, 0]) + rng.normal(size=(5, 4))
    np.testing.assert_allclose(jax.vmap(cost.base)(x), reference.quadratic(x, GOAL, QX), rtol=1e-13)
    np.testing.assert_allclose(
        jax.vmap(cost.terminal)(x), reference.quadratic(x, GOAL, QT), rtol=1e-13
    )
    np.testing.assert_allclose(jax.vmap(light_dark.penalty)(x), penalty(x), rtol=1e-13)
    np.testing.assert_allclose(cost.R, 0.035 * np.eye(2))
    assert isinstance(cost, Cost)
    assert isinstance(cost, ClosedFormCost)


def test_full_weights_are_taken_as_they_are(x64, rng):
    Q = random_spd(rng, 4)
    R = random_spd(rng, 2)
    cost = light_dark_problem(
        cost={"running_weight": Q, "terminal_weight": 2 * Q, "control_weight": R}
    ).cost
    x = rng.normal(size=4)
    cov = random_spd(rng, 4)
    np.testing.assert_allclose(cost.base(x), reference.quadratic(x[None], GOAL, Q)[0], rtol=1e-13)
    np.testing.assert_allclose(cost.R, R)
    np.testing.assert_allclose(
        cost.terminal_mean(x, cov), cost.terminal(x) + 0.5 * np.trace(2 * Q @ cov), rtol=1e-13
    )  # eq. (4)


def test_expected_base_cost_is_eq_4(light_dark, x64, rng):
    mean = rng.normal(size=4)
    cov = random_spd(rng, 4)
    moments = running_moments(light_dark, mean, cov)
    np.testing.assert_allclose(
        moments.base, light_dark.cost.base(mean) + 0.5 * np.trace(QX @ cov), rtol=1e-13
    )


@pytest.mark.parametrize("w_obs", [1.0, 500.0, 1e4])
def test_total_variance_equals_quadrature(w_obs, x64, rng):
    """Takes a state that is a position, so that a quadrature has two dimensions only."""
    problem = light_dark_problem(
        cost={
            "goal": [7, 0],
            "running_weight": [1.5, 1.5],
            "terminal_weight": [5, 5],
            "w_obs": w_obs,
        }
    )
    for spread in (0.02, 0.3):
        mean = np.array([2.6, 0.7])
        cov = spread**2 * random_spd(rng, 2)
        m = running_moments(problem, mean, cov)
        expected = reference.covariance(
            lambda x: reference.quadratic(x, GOAL[:2], QX[:2, :2]),
            lambda x: penalty(x, w_obs),
            mean,
            cov,
        )
        np.testing.assert_allclose(
            (m.base, m.penalty, m.base_var, m.penalty_var, m.covariance), expected, rtol=1e-9
        )


@pytest.mark.parametrize("spread", [1e-4, 0.03, 0.3, 1.0])
def test_float32_keeps_five_digits_at_the_largest_weight(spread):
    problem = light_dark_problem(cost={"goal": [7, 0], "running_weight": [1.5, 1.5], "w_obs": 1e4})
    mean = np.array([2.6, 0.7], dtype=np.float32)
    cov = (spread**2 * np.array([[1, 0.4], [0.4, 0.8]])).astype(np.float32)
    m = running_moments(problem, mean, cov)
    expected = reference.covariance(
        lambda x: reference.quadratic(x, GOAL[:2], QX[:2, :2]),
        lambda x: penalty(x, 1e4),
        mean.astype(np.float64),
        cov.astype(np.float64),
    )
    assert m.penalty_var.dtype == np.float32
    np.testing.assert_allclose(
        (m.base, m.penalty, m.base_var, m.penalty_var, m.covariance), expected, rtol=1e-5
    )


def test_all_moments_equal_those_of_samples_of_the_full_state(light_dark, x64, rng):
    mean = np.array([2.5, 0.6, 0.4, 0.1])
    cov = 0.3**2 * random_spd(rng, 4)
    m = running_moments(light_dark, mean, cov)
    x = rng.multivariate_normal(mean, cov, 200_000)
    base = reference.quadratic(x, GOAL, QX)
    bumps = penalty(x)
    total = base + bumps
    for moment, values in ((m.base, base), (m.penalty, bumps)):
        assert abs(values.mean() - moment) < SIGMAS * values.std() / np.sqrt(len(x))
    deviations = [v - v.mean() for v in (base, bumps, total)]
    total_var = m.base_var + 2 * m.covariance + m.penalty_var
    for moment, (a, b) in (
        (m.base_var, (0, 0)),
        (m.penalty_var, (1, 1)),
        (m.covariance, (0, 1)),
        (total_var, (2, 2)),
    ):
        products = deviations[a] * deviations[b]
        assert abs(products.mean() - moment) < SIGMAS * products.std() / np.sqrt(len(x))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), log_spread=st.floats(-5, 2))
def test_moments_obey_cauchy_and_schwarz_in_float32(seed, log_spread):
    rng = np.random.default_rng(seed)
    problem = light_dark_problem(cost={"w_obs": 1e4})
    mean = np.array([3, 0, 0, 0]) + rng.normal(size=4) * [2, 2, 1, 1]
    cov = 10 ** (2 * log_spread) * random_spd(rng, 4)
    m = running_moments(problem, mean.astype(np.float32), cov.astype(np.float32))
    assert all(np.isfinite(m))
    assert min(m.base_var, m.penalty_var) >= 0
    total = float(m.base_var) + 2 * float(m.covariance) + float(m.penalty_var)
    assert total >= -1e-5 * float(m.base_var + m.penalty_var)
    assert float(m.covariance) ** 2 <= (1 + 1e-4) * float(m.base_var) * float(m.penalty_var) + 1e-30


@pytest.mark.parametrize(
    "change",
    [
        {"obstacles": mb.Obstacles(np.zeros((0, 2)), 0.65)},
        {"obstacles": mb.Obstacles([], 0.65)},
        {"obstacles": None},
        {"cost": {"w_obs": 0}},
    ],
)
def test_without_obstacles_only_the_goal_counts(change, x64, rng):
    bare = light_dark_problem(**change)
    mean = np.array([2.5, 0.6, 0, 0])
    cov = random_spd(rng, 4)
    full = running_moments(light_dark_problem(), mean, cov)
    m = running_moments(bare, mean, cov)
    assert (m.penalty, m.penalty_var, m.covariance) == (0, 0, 0)
    np.testing.assert_allclose([m.base, m.base_var], [full.base, full.base_var], rtol=1e-14)
    assert bare.penalty(jnp.asarray(mean)) == 0


def test_obstacle_moments_scale_with_the_weight(x64, rng):
    mean = np.array([2.5, 0.6, 0, 0])
    cov = 0.1 * random_spd(rng, 4)
    single, heavy = (
        running_moments(light_dark_problem(cost={"w_obs": w}), mean, cov) for w in (1, 1e4)
    )
    np.testing.assert_allclose(heavy.penalty, 1e4 * single.penalty, rtol=1e-13)
    np.testing.assert_allclose(heavy.penalty_var, 1e8 * single.penalty_var, rtol=1e-13)
    np.testing.assert_allclose(heavy.covariance, 1e4 * single.covariance, rtol=1e-13)
    assert (heavy.base, heavy.base_var) == (single.base, single.base_var)


@pytest.mark.parametrize(("field", "value"), [("w_obs", -1), ("goal", 7), ("running_weight", 1.5)])
def test_a_cost_refuses_numbers_without_meaning(field, value):
    with pytest.raises(ValueError, match=field):
        light_dark_problem(cost={field: value})


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("running_weight", [-1, 1, 1, 1]),
        ("running_weight", [[1, 1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
        ("terminal_weight", [[1, 2], [2, 1]]),
        ("control_weight", [0, 1]),
        ("control_weight", [[1, 1], [1, 1]]),
    ],
)
def test_weights_that_are_not_symmetric_or_not_definite_are_refused(field, value):
    with pytest.raises(ValueError, match=field):
        light_dark_problem(cost={field: value})
