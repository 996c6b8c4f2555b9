"""Tests how near the straight lines between positions come to obstacles."""

import itertools
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import mppi_belief as mb
from helpers import light_dark_problem, quick_jit
from mppi_belief.obstacles.segments import MAX_INTERVALS, path_clearance

RESOLUTION = 0.01  # m, the default of a problem
DENSE = np.linspace(0, 1, 1001)[:, None]  # parts of a step


@mb.struct
class Wall:
    """Represents a wall across the first component of the position."""

    edge: float = mb.number()
    thickness: float = mb.number()

    def clearance(self, position: Array) -> Array:
        return jnp.abs(position[0] - self.edge - self.thickness / 2) - self.thickness / 2


@mb.struct
class PlainDiscs:
    """Represents discs as a user writes them: the closed form of a step is missing."""

    discs: mb.Obstacles

    def clearance(self, position: Array) -> Array:
        return self.discs.clearance(position)


@mb.struct
class Growing(mb.Obstacles):
    """Represents discs that are larger than those of which they inherit the closed form."""

    def clearance(self, position: Array) -> Array:
        return mb.Obstacles.clearance(self, position) - 0.5


@quick_jit
def clearances(obstacles: mb.ObstacleShape, positions: Array, resolution: float) -> Array:
    return path_clearance(obstacles, positions, resolution)


def dense_clearances(positions: np.ndarray, centers: np.ndarray, radius: float) -> np.ndarray:
    """Returns the least distances (T,) of 1001 points of each step to discs."""
    least = []
    for start, end in itertools.pairwise(positions):
        points = start + DENSE * (end - start)
        apart = np.linalg.norm(points[:, None] - centers, axis=-1)
        least.append(np.min(apart) - radius)
    return np.array(least)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_the_closed_form_of_discs_is_the_least_of_very_many_points(d, rng, x64):
    positions = 2 * rng.normal(size=(100, d))
    positions[50] = positions[49]
    centers = rng.normal(size=(4, d))
    exact = clearances(mb.Obstacles(centers, 0.3), positions, RESOLUTION)
    dense = dense_clearances(positions, centers, 0.3)
    longest = np.max(np.linalg.norm(np.diff(positions, axis=0), axis=1))
    assert np.all(exact <= dense + 1e-12)
    assert np.all(exact >= dense - longest / 2000)
    assert exact[49] == pytest.approx(dense[49], abs=1e-12)


@pytest.mark.parametrize("resolution", [0.3, 0.02])
def test_points_of_a_step_come_within_half_the_resolution_of_the_closed_form(resolution, rng, x64):
    positions = 2 * rng.normal(size=(100, 2))
    discs = mb.Obstacles(rng.normal(size=(4, 2)), 0.3)
    exact = clearances(discs, positions, resolution)
    sampled = clearances(PlainDiscs(discs), positions, resolution)
    assert np.all(sampled >= exact - 1e-12)
    assert np.all(sampled <= exact + resolution / 2 + 1e-12)


@pytest.mark.parametrize("kind", [lambda discs: discs, PlainDiscs], ids=["exact", "sampled"])
def test_a_step_is_never_farther_than_its_ends_also_in_single_precision(kind, rng):
    positions = jnp.asarray(rng.normal(size=(400, 2)), "float32")
    obstacles = kind(mb.Obstacles(rng.normal(size=(3, 2)), 0.2))
    at_ends = np.asarray(jax.vmap(obstacles.clearance)(positions))
    steps = clearances(obstacles, positions, RESOLUTION)
    assert steps.dtype == at_ends.dtype
    assert np.all(steps <= np.minimum(at_ends[:-1], at_ends[1:]))


def test_every_obstacle_as_thick_as_the_resolution_is_met(rng, x64):
    """Puts 500 walls anywhere on a step; thinner ones are missed now and then."""
    positions = jnp.array([[-0.5, 0.0], [0.37, 0.2]])
    edges = jnp.asarray(rng.uniform(-0.5, 0.35, 500))

    def met(part: float) -> np.ndarray:
        """Returns which walls are met whose crossing takes this part of the resolution."""
        thickness = part * RESOLUTION * 0.87 / np.hypot(0.87, 0.2)
        over_walls = jax.vmap(lambda edge: clearances(Wall(edge, thickness), positions, RESOLUTION))
        return np.asarray(over_walls(edges)) <= 0

    assert np.all(met(1.0))
    assert not np.all(met(0.5))


def test_a_very_long_step_is_divided_into_a_bounded_number_of_parts(x64):
    length = 10 * MAX_INTERVALS * RESOLUTION
    positions = jnp.array([[0.0], [length]])
    spacing = length / MAX_INTERVALS
    assert clearances(Wall(length / 3, 1.01 * spacing), positions, RESOLUTION) <= 0
    assert clearances(Wall(length / 2 + 0.3 * spacing, 0.4 * spacing), positions, RESOLUTION) > 0


@pytest.mark.parametrize("kind", [lambda discs: discs, PlainDiscs], ids=["exact", "sampled"])
def test_steps_that_leave_the_finite_numbers_end_and_are_not_judged(kind):
    obstacles = kind(mb.Obstacles([[0.0, 0.0]], 0.1))
    positions = jnp.array([[1.0, 1.0], [2.0, 1.0], [jnp.nan, 1.0]], "float32")
    steps = clearances(obstacles, positions, RESOLUTION)
    assert steps[0] == pytest.approx(np.sqrt(2) - 0.1, rel=1e-6)
    assert np.isnan(steps[1])


def test_huge_and_tiny_steps_have_the_closed_form_in_single_precision():
    discs = mb.Obstacles([[0.0, 0.5]], 0.1)
    huge = jnp.array([[-1e25, 0.0], [1e25, 0.0]], "float32")
    tiny = jnp.array([[-1e-25, 0.0], [1e-25, 0.0]], "float32")
    assert clearances(discs, huge, RESOLUTION) == pytest.approx(0.4, rel=1e-6)
    assert clearances(discs, tiny, RESOLUTION) == pytest.approx(0.4, rel=1e-6)


def test_a_clearance_of_a_subclass_is_not_judged_by_the_closed_form_it_inherits(x64):
    positions = jnp.array([[-1.0, 0.0], [1.0, 0.0]])
    discs = Growing([[0.0, 1.0]], 0.25)
    assert clearances(mb.Obstacles([[0.0, 1.0]], 0.25), positions, RESOLUTION) == 0.75
    assert clearances(discs, positions, RESOLUTION) == pytest.approx(0.25, abs=1e-4)


def test_a_problem_takes_the_position_of_its_states_and_its_own_resolution(x64):
    positions = np.array([[0.9, 1.9], [3.0, 0.0], [5.0, 0.3]])
    states = jnp.asarray(np.hstack([np.full((3, 2), 7.0), positions]))
    problem = light_dark_problem(position=(2, 3))
    exact = problem.path_clearance(states)
    centers = np.array([[3, 1], [3, -1]])
    np.testing.assert_allclose(exact, dense_clearances(positions, centers, 0.65), atol=2e-3)

    # The second step is divided into 203 parts; the wall lies in the middle of one.
    thin = replace(problem, obstacles=Wall(3 + 100.5 * 2 / 203 - 0.001, 0.002))
    assert thin.path_clearance(states)[1] > 0
    assert replace(thin, collision_resolution=0.002).path_clearance(states)[1] <= 0

    free = replace(problem, obstacles=None)
    np.testing.assert_array_equal(free.path_clearance(states), [np.inf, np.inf])
