"""Tests distances to discs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb


@pytest.mark.parametrize("d", [1, 2, 3])
def test_clearance_is_the_least_distance_less_the_radius(d, rng, x64):
    centers = rng.normal(size=(4, d))
    position = rng.normal(size=d)
    expected = min(np.linalg.norm(position - c) for c in centers) - 0.3
    clearance = mb.Obstacles(centers, 0.3).clearance
    np.testing.assert_allclose(clearance(jnp.asarray(position)), expected, rtol=1e-12)
    np.testing.assert_allclose(jax.jit(clearance)(jnp.asarray(position)), expected, rtol=1e-12)


def test_clearance_changes_sign_on_the_surface():
    obstacles = mb.Obstacles([[3, 1], [3, -1]], 0.65)
    assert obstacles.clearance(jnp.array([3.0, 1.0])) == pytest.approx(-0.65)
    assert obstacles.clearance(jnp.array([3.0, 0.0])) == pytest.approx(0.35)
    assert obstacles.clearance(jnp.array([2.0, 1.0])) == pytest.approx(0.35)


@pytest.mark.parametrize("centers", [np.zeros((0, 2)), []])
def test_without_obstacles_the_clearance_is_infinite(centers):
    obstacles = mb.Obstacles(centers, 0.65)
    assert obstacles.centers.ndim == 2
    assert obstacles.clearance(jnp.zeros(2)) == np.inf


def test_a_negative_radius_is_refused():
    with pytest.raises(ValueError, match="radius"):
        mb.Obstacles([[0, 0]], -1)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_few_discs_are_as_far_as_among_many(d, rng, x64):
    """Few are computed one by one, many as one array."""
    centers = rng.normal(size=(40, d))
    position = jnp.asarray(rng.normal(size=d))
    many = mb.Obstacles(centers, 0.3)
    few = mb.Obstacles(centers[:5], 0.3)
    np.testing.assert_array_equal(few.distances(position), many.distances(position)[:5])
    gradients = [jax.jacobian(discs.distances)(position)[:5] for discs in (few, many)]
    np.testing.assert_allclose(*gradients, rtol=1e-12)
    at_center = jax.jacobian(few.distances)(jnp.asarray(centers[2]))
    np.testing.assert_array_equal(at_center[2], np.zeros(d))
