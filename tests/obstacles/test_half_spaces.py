"""Tests walls: their distances, what they refuse, and the exact clearance of a line."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb


def test_distances_are_normal_to_the_walls(x64):
    walls = mb.HalfSpaces([[2, 0], [0, -1], [3, 4]], [6, 1, 5])
    position = jnp.array([4.0, 2.0])
    np.testing.assert_allclose(walls.distances(position), [1.0, -3.0, 3.0])
    np.testing.assert_allclose(jax.jit(lambda shape: shape.clearance(position))(walls), -3.0)
    assert isinstance(walls, mb.ObstacleDistances)
    assert isinstance(walls, mb.ClosedFormClearance)


def test_the_clearance_of_a_line_is_that_of_an_end(x64, rng):
    walls = mb.HalfSpaces(rng.normal(size=(3, 2)), rng.normal(size=3))
    start, end = rng.normal(size=(2, 2))
    points = start + np.linspace(0, 1, 101)[:, None] * (end - start)
    least = min(float(walls.clearance(jnp.asarray(point))) for point in points)
    np.testing.assert_allclose(walls.segment_clearance(jnp.asarray(start), jnp.asarray(end)), least)


def test_without_walls_the_clearance_is_infinite():
    assert mb.HalfSpaces([], []).clearance(jnp.zeros(2)) == np.inf


@pytest.mark.parametrize(
    ("normals", "offsets", "reason"),
    [
        ([[1, 0], [0, 0]], [1, 1], r"normals must not be zero, got \[0.0, 0.0\]"),
        ([[1, 0]], [1, 1], "offsets must be one per normal, got 2 for 1"),
        ([1, 0], [1], r"normals must have 2 dimension\(s\), got 1"),
    ],
)
def test_walls_without_meaning_are_refused(normals, offsets, reason):
    with pytest.raises(ValueError, match=reason):
        mb.HalfSpaces(normals, offsets)


def test_a_position_of_another_size_is_refused():
    with pytest.raises(ValueError, match="do not fit a position of 3"):
        mb.HalfSpaces([[1, 0]], [0]).clearance(jnp.zeros(3))
