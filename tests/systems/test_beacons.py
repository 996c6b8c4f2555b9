"""Tests the unicycle among beacons: distances, bearings, their curvature and their wrapping."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb
from helpers import quick_jit
from mppi_belief.discretise import measurement_difference
from system_helpers import ANCHOR, BEACONS, beacons, turned


def sensor(p: np.ndarray) -> np.ndarray:
    """Returns distance and direction (n, 2) of each beacon from a position (2,)."""
    offsets = BEACONS - p
    return np.column_stack([np.hypot(*offsets.T), np.arctan2(offsets[:, 1], offsets[:, 0])])


@quick_jit
def sensed(system: mb.Beacons, states: np.ndarray) -> jax.Array:
    """Returns distances and bearings (P, n, 2) from states (P, 4)."""
    return jax.vmap(lambda x: system.c(x).reshape(-1, 2))(states)


@quick_jit
def jacobian(system: mb.Beacons, x: np.ndarray) -> jax.Array:
    """Returns the derivative (2 n, 4) of the measurements."""
    return jax.jacfwd(system.c)(x)


def random_states(rng: np.random.Generator, n: int = 8) -> np.ndarray:
    """Returns states (n, 4) among the beacons."""
    return np.column_stack(
        [
            rng.uniform(-1, 6, n),
            rng.uniform(-1.5, 1.5, n),
            rng.uniform(-3, 3, n),
            rng.normal(size=n),
        ]
    )


def test_the_unicycle_moves_where_it_heads(rng):
    system = beacons()
    x = random_states(rng)
    expected = np.column_stack(
        [x[:, 3] * np.cos(x[:, 2]), x[:, 3] * np.sin(x[:, 2]), np.zeros((len(x), 2))]
    )
    np.testing.assert_allclose(quick_jit(jax.vmap(system.f))(x), expected, atol=1e-6)
    np.testing.assert_array_equal(system.G(jnp.zeros(4)), [[0, 0], [0, 0], [1, 0], [0, 1]])
    np.testing.assert_allclose(system.H, [[0, 0], [0, 0], [0.2, 0], [0, 0.4]], rtol=1e-6)


def test_it_measures_distance_and_bearing(x64, rng):
    states = random_states(rng)
    for x, y in zip(states, sensed(beacons(), states), strict=True):
        expected = sensor(x[:2])
        np.testing.assert_allclose(y[:, 0], expected[:, 0], rtol=1e-12)
        np.testing.assert_allclose(turned(y[:, 1] - expected[:, 1] + x[2]), 0, atol=1e-12)


@pytest.mark.parametrize("kappa", [0.0, 1e-9, 0.3, 1.7])
def test_curvature_scales_the_way_from_the_anchor(x64, rng, kappa):
    """Compares with c_kappa by its definition, and at zero with the derivative at the anchor."""
    value = sensor(ANCHOR)
    scale = max(kappa, 1e-5)
    states = random_states(rng)
    for x, y in zip(states, sensed(beacons(curvature=kappa), states), strict=True):
        change = sensor(ANCHOR + scale * (x[:2] - ANCHOR)) - value
        change[:, 1] = turned(change[:, 1])
        error = y - value - change / scale + np.array([0.0, x[2]])
        np.testing.assert_allclose(error, 0, atol=1e-9 if kappa >= 1e-5 else 2e-3)


def test_value_and_derivative_at_the_anchor_do_not_depend_on_curvature(x64):
    x = np.array([*ANCHOR, 0.4, 1.0])
    value = sensed(beacons(), x[None])
    derivative = jacobian(beacons(), x)
    for kappa in (0.0, 0.5, 3.0):
        system = beacons(curvature=kappa)
        np.testing.assert_allclose(sensed(system, x[None]), value, atol=1e-12)
        np.testing.assert_allclose(jacobian(system, x), derivative, atol=1e-12)


def test_without_curvature_it_is_affine_also_in_single_precision(rng):
    system = beacons(curvature=0.0)
    a, b = random_states(rng, 2)
    states = np.stack([a, b, (a + b) / 2]).astype(np.float32)
    y = sensed(system, states)
    np.testing.assert_allclose(y[2], (y[0] + y[1]) / 2, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(sensed(beacons(curvature=1e-6), states), y, rtol=1e-5, atol=1e-5)


def test_noise_grows_with_distance(rng):
    states = random_states(rng)
    for kappa in (0.0, 1.0):
        factors = quick_jit(jax.vmap(beacons(curvature=kappa).sigma_o))(states)
        for x, sigma_o in zip(states, factors, strict=True):
            distances = sensor(x[:2])[:, 0]
            deviations = np.column_stack([0.1 + 0.2 * distances, 0.03 + 0.05 * distances])
            np.testing.assert_allclose(sigma_o, np.diag(deviations.ravel()), rtol=1e-5)


@pytest.mark.parametrize("kappa", [0.5, 1.0])
def test_a_period_more_of_a_bearing_is_the_same_measurement(x64, rng, kappa):
    system = beacons(curvature=kappa)
    y, predicted = rng.normal(size=(2, 6))
    periods = np.ravel(np.column_stack([np.zeros(3), [1, -2, 3]])) * 2 * np.pi / kappa
    expected = y - predicted
    difference = measurement_difference(system, y + periods, predicted)
    np.testing.assert_allclose(difference, expected, atol=1e-12)
    affine = beacons(curvature=0.0).difference(y + periods, predicted)
    np.testing.assert_allclose(affine, expected + periods, atol=1e-12)


@pytest.mark.parametrize(
    "filter", [mb.EKF(), mb.UKF(), mb.ParticleFilter(50)], ids=["ekf", "ukf", "particle"]
)
def test_every_filter_takes_a_bearing_for_what_it_is_modulo_a_turn(x64, filter):
    """Starts behind a beacon, where its bearing is about to jump by a whole turn."""
    cost = mb.GoalObstacleCost([6, 0, 0, 0], [1] * 4, [1] * 4, [1] * 2)
    mean = [1.0, -4.0, 0.0, 0.5]
    problem = mb.Problem(
        beacons(anchor=[1.0, 1.0]), cost, mean, [0.3, 0.3, 0.1, 0.1], dt=0.1, steps=1
    )
    jump = jnp.pi * jnp.array([0, 2.0, 0, -2.0, 0, 0])
    key = jax.random.key(0)
    u = jnp.zeros(2)
    states = np.array(mean) + np.array([[-1e-3, 0, 0, 0], [1e-3, 0, 0, 0]])
    beside = sensed(problem.system, states).reshape(2, -1)
    assert abs(beside[0, 1] - beside[1, 1]) > 6  # the jump is really there
    update = quick_jit(lambda y: filter.update(problem, filter.init(problem, key), u, y, key))
    y = beside.mean(axis=0).at[1].set(beside[0, 1]) + 0.02
    posterior = update(y)
    after_jump = update(y + jump)
    np.testing.assert_allclose(posterior.mean, after_jump.mean, atol=1e-9)
    np.testing.assert_allclose(posterior.cov, after_jump.cov, atol=1e-9)
    assert jnp.all(jnp.abs(posterior.mean - jnp.asarray(mean)) < 1)


@pytest.mark.parametrize(
    ("field", "value"),
    [("distance_floor", 0), ("bearing_floor", 0), ("curvature", -1), ("beacons", [1, 2])],
)
def test_beacons_refuse_numbers_without_meaning(field, value):
    with pytest.raises(ValueError, match=field):
        replace(beacons(), **{field: value})
