"""Tests the profiles of penalties, their sum over obstacles, and what they refuse."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb
from helpers import light_dark_problem
from mppi_belief.costs.penalties.totals import penalty_sum

DISCS = mb.Obstacles([[3, 1], [3, -1]], 0.65)
DISTANCES = np.array([-0.3, -1e-3, 0.0, 1e-3, 0.1, 0.2, 0.21, 5.0])
DEPTHS = np.maximum(0.2 - DISTANCES, 0)
T = np.minimum(DEPTHS / 0.2, 1)
PROFILES = [
    (mb.Hinge(0.2), DEPTHS),
    (mb.SquaredHinge(0.2), DEPTHS**2),
    (mb.SmoothStep(0.2), 3 * T**2 - 2 * T**3),
    (mb.Indicator(0.2), np.where(DISTANCES < 0.2, 1.0, 0.0)),
]


def name_of(value: object) -> str:
    return type(value).__name__ if isinstance(value, mb.SurfacePenalty) else ""


@pytest.mark.parametrize(("penalty", "values"), PROFILES, ids=name_of)
def test_profiles_by_their_formulas(penalty, values, x64):
    np.testing.assert_allclose(penalty.profile(jnp.asarray(DISTANCES)), values, atol=1e-15)
    assert isinstance(penalty, mb.SurfacePenalty)
    assert not isinstance(penalty, mb.CenterPenalty)


@pytest.mark.parametrize(("penalty", "values"), PROFILES, ids=name_of)
def test_the_penalty_is_the_weighted_sum_over_obstacles(penalty, values, x64):
    problem = light_dark_problem(cost={"w_obs": 7.0, "obstacle_penalty": penalty})
    x = jnp.array([3.1, 0.3, 1.0, 1.0])
    distances = np.hypot(0.1, [0.7, 1.3]) - 0.65
    np.testing.assert_allclose(DISCS.distances(x[:2]), distances, rtol=1e-12)
    expected = 7.0 * sum(float(penalty.profile(jnp.asarray(d))) for d in distances)
    np.testing.assert_allclose(problem.penalty(x), expected, rtol=1e-12)


class PlainShape:
    """Represents discs that say their clearance only."""

    def clearance(self, position):
        return DISCS.clearance(position)


class Halves(mb.Obstacles):
    """Changes the clearance of discs, and inherits their distances."""

    def clearance(self, position):
        return super().clearance(position) / 2


def test_a_shape_without_distances_counts_as_one_obstacle(x64):
    penalty = mb.Hinge(2.0)
    x = jnp.array([3.0, 0.2])
    nearest = 2.0 - (0.8 - 0.65)
    both = nearest + 2.0 - (1.2 - 0.65)
    for shape, expected in [
        (DISCS, both),
        (PlainShape(), nearest),
        (Halves(DISCS.centers, DISCS.radius), 2.0 - (0.8 - 0.65) / 2),
    ]:
        value = penalty_sum(penalty, x, mb.Surroundings(shape, None))
        np.testing.assert_allclose(value, expected, rtol=1e-12)


@pytest.mark.parametrize("penalty", [mb.Bump(), mb.Hinge(0.2)], ids=lambda p: type(p).__name__)
@pytest.mark.parametrize("shape", [None, mb.Obstacles([], 1.0), mb.Obstacles(np.zeros((0, 2)), 1)])
def test_without_obstacles_there_is_no_penalty(penalty, shape):
    assert penalty_sum(penalty, jnp.ones(2), mb.Surroundings(shape, None)) == 0


@pytest.mark.parametrize(("penalty", "values"), PROFILES, ids=name_of)
def test_gradients_are_finite_at_the_kinks_and_at_a_centre(penalty, values):
    problem = light_dark_problem(cost={"w_obs": 7.0, "obstacle_penalty": penalty})
    for x in ([3.0, 1.0], [3.0, 0.35], [3.0, 0.15], [2.9, 0.9]):
        state = jnp.array([*x, 0.0, 0.0])
        assert jnp.all(jnp.isfinite(jax.grad(problem.penalty)(state)))
        assert jnp.all(jnp.isfinite(jax.hessian(problem.penalty)(state)))


@pytest.mark.parametrize(
    ("kind", "name", "value", "reason"),
    [
        (mb.Hinge, "margin", -0.1, "must be at least 0, got -0.1"),
        (mb.SquaredHinge, "margin", -0.1, "must be at least 0, got -0.1"),
        (mb.Indicator, "margin", -0.1, "must be at least 0, got -0.1"),
        (mb.SmoothStep, "margin", 0, "must be greater than 0, got 0"),
        (mb.Bump, "width", 0, "must be greater than 0, got 0"),
    ],
)
def test_numbers_without_meaning_are_refused(kind, name, value, reason):
    with pytest.raises(ValueError, match=f"^{name} {reason}$"):
        kind(value)


def test_a_bump_needs_centres():
    problem = light_dark_problem(obstacles=PlainShape())
    with pytest.raises(ValueError, match="Bump needs obstacles with centers, PlainShape has none"):
        problem.penalty(jnp.zeros(4))


def test_what_is_no_penalty_is_refused():
    problem = light_dark_problem(cost={"obstacle_penalty": "hinge"})
    with pytest.raises(ValueError, match=r"must have profile\(distance\), str has none"):
        problem.penalty(jnp.zeros(4))


def test_no_two_penalties_share_a_compiled_program():
    structures = [jax.tree.structure(penalty) for penalty, _ in PROFILES]
    structures.append(jax.tree.structure(mb.Bump(0.2)))
    for i, structure in enumerate(structures):
        assert structure not in structures[:i]
