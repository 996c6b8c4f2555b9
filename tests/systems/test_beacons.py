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
    """Distance and direction (n, 2) of each beacon from a position."""
    to = BEACONS - p
    return np.column_stack([np.hypot(*to.T), np.arctan2(to[:, 1], to[:, 0])])


@quick_jit
def measured(system: mb.Beacons, at: np.ndarray) -> jax.Array:
    """Distances and bearings (P, n, 2) from states (P, 4)."""
    return jax.vmap(lambda x: system.c(x).reshape(-1, 2))(at)


@quick_jit
def slopes(system: mb.Beacons, x: np.ndarray) -> jax.Array:
    return jax.jacfwd(system.c)(x)


def states(rng: np.random.Generator, n: int = 8) -> np.ndarray:
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
    x = states(rng)
    expected = np.column_stack(
        [x[:, 3] * np.cos(x[:, 2]), x[:, 3] * np.sin(x[:, 2]), np.zeros((len(x), 2))]
    )
    np.testing.assert_allclose(quick_jit(jax.vmap(system.f))(x), expected, atol=1e-6)
    np.testing.assert_array_equal(system.G(jnp.zeros(4)), [[0, 0], [0, 0], [1, 0], [0, 1]])
    np.testing.assert_allclose(system.H, [[0, 0], [0, 0], [0.2, 0], [0, 0.4]], rtol=1e-6)


def test_it_measures_distance_and_bearing(x64, rng):
    at = states(rng)
    for x, found in zip(at, measured(beacons(), at), strict=True):
        expected = sensor(x[:2])
        np.testing.assert_allclose(found[:, 0], expected[:, 0], rtol=1e-12)
        np.testing.assert_allclose(turned(found[:, 1] - expected[:, 1] + x[2]), 0, atol=1e-12)


@pytest.mark.parametrize("kappa", [0.0, 1e-9, 0.3, 1.7])
def test_curvature_scales_the_way_from_the_anchor(x64, rng, kappa):
    """c_kappa by its definition; at zero by the sensor's slope at the anchor."""
    at, shrunk, there = sensor(ANCHOR), max(kappa, 1e-5), states(rng)
    for x, found in zip(there, measured(beacons(curvature=kappa), there), strict=True):
        moved = sensor(ANCHOR + shrunk * (x[:2] - ANCHOR)) - at
        moved[:, 1] = turned(moved[:, 1])
        off = found - at - moved / shrunk + np.array([0.0, x[2]])
        np.testing.assert_allclose(off, 0, atol=1e-9 if kappa >= 1e-5 else 2e-3)


def test_value_and_slope_at_the_anchor_do_not_depend_on_curvature(x64):
    x = np.array([*ANCHOR, 0.4, 1.0])
    value, slope = (
        np.asarray(part) for part in (measured(beacons(), x[None]), slopes(beacons(), x))
    )
    for kappa in (0.0, 0.5, 3.0):
        system = beacons(curvature=kappa)
        np.testing.assert_allclose(measured(system, x[None]), value, atol=1e-12)
        np.testing.assert_allclose(slopes(system, x), slope, atol=1e-12)


def test_without_curvature_it_is_affine_also_in_single_precision(rng):
    system = beacons(curvature=0.0)
    a, b = states(rng, 2)
    at = np.stack([a, b, (a + b) / 2]).astype(np.float32)
    ends = measured(system, at)
    np.testing.assert_allclose(ends[2], (ends[0] + ends[1]) / 2, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(measured(beacons(curvature=1e-6), at), ends, rtol=1e-5, atol=1e-5)


def test_noise_grows_with_distance(rng):
    at = states(rng)
    for kappa in (0.0, 1.0):
        noise = quick_jit(jax.vmap(beacons(curvature=kappa).sigma_o))(at)
        for x, found in zip(at, noise, strict=True):
            far = sensor(x[:2])[:, 0]
            deviations = np.column_stack([0.1 + 0.2 * far, 0.03 + 0.05 * far]).ravel()
            np.testing.assert_allclose(found, np.diag(deviations), rtol=1e-5)


@pytest.mark.parametrize("kappa", [0.5, 1.0])
def test_a_period_more_of_a_bearing_is_the_same_measurement(x64, rng, kappa):
    system = beacons(curvature=kappa)
    y, other = rng.normal(size=(2, 6))
    more = np.ravel(np.column_stack([np.zeros(3), [1, -2, 3]])) * 2 * np.pi / kappa
    expected = y - other
    np.testing.assert_allclose(
        measurement_difference(system, y + more, other), expected, atol=1e-12
    )
    straight = beacons(curvature=0.0)
    np.testing.assert_allclose(straight.difference(y + more, other), expected + more, atol=1e-12)


@pytest.mark.parametrize(
    "filter", [mb.EKF(), mb.UKF(), mb.ParticleFilter(50)], ids=["ekf", "ukf", "particle"]
)
def test_every_filter_takes_a_bearing_for_what_it_is_modulo_a_turn(x64, filter):
    """From a place behind a beacon, where its bearing is about to jump by a turn."""
    cost = mb.GoalObstacleCost([6, 0, 0, 0], [1] * 4, [1] * 4, [1] * 2)
    mean = [1.0, -4.0, 0.0, 0.5]
    problem = mb.Problem(
        beacons(anchor=[1.0, 1.0]), cost, mean, [0.3, 0.3, 0.1, 0.1], dt=0.1, steps=1
    )
    jump = jnp.pi * jnp.array([0, 2.0, 0, -2.0, 0, 0])
    system, key, u = problem.system, jax.random.key(0), jnp.zeros(2)
    beside = measured(
        system, np.array(mean) + np.array([[-1e-3, 0, 0, 0], [1e-3, 0, 0, 0]])
    ).reshape(2, -1)
    assert abs(beside[0, 1] - beside[1, 1]) > 6  # the jump is really there
    update = quick_jit(lambda y: filter.update(problem, filter.init(problem, key), u, y, key))
    y = beside.mean(axis=0).at[1].set(beside[0, 1]) + 0.02
    one, other = update(y), update(y + jump)
    np.testing.assert_allclose(one.mean, other.mean, atol=1e-9)
    np.testing.assert_allclose(one.cov, other.cov, atol=1e-9)
    assert jnp.all(jnp.abs(one.mean - jnp.asarray(mean)) < 1)


@pytest.mark.parametrize(
    ("field", "value"),
    [("distance_floor", 0), ("bearing_floor", 0), ("curvature", -1), ("beacons", [1, 2])],
)
def test_numbers_without_meaning_are_refused(field, value):
    with pytest.raises(ValueError, match=field):
        replace(beacons(), **{field: value})
