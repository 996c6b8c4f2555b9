"""Tests the moments of penalties at walls against adaptive quadrature, samples and limits."""

from itertools import pairwise

import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array
from scipy import integrate, stats

import mppi_belief as mb
from helpers import SIGMAS, light_dark_problem, quick_jit, random_spd
from mppi_belief.belief import cost as belief_cost

PENALTIES = [mb.Hinge(0.2), mb.SquaredHinge(0.2), mb.SmoothStep(0.2), mb.Indicator(0.2)]
WALLS = mb.HalfSpaces([[1, 0.2], [0, -1], [0.5, -0.8]], [2.2, -0.9, 0.3])

running_moments = quick_jit(belief_cost.running_moments)
distance_moments = quick_jit(lambda penalty, mean, sd: penalty.distance_moments(mean, sd))


def name_of(value: object) -> str:
    return type(value).__name__


def expected(penalty: mb.SurfacePenalty, mean: float, sd: float) -> tuple[float, float]:
    """Returns expectation and variance by adaptive quadrature, cut at the kinks."""
    law = stats.norm(mean, sd)
    low = mean - 12 * sd
    high = mean + 12 * sd
    edges = [low, *[edge for edge in (0.0, 0.2) if low < edge < high], high]

    def integral(function) -> float:
        parts = pairwise(edges)
        values = [
            integrate.quad(lambda d: function(d) * law.pdf(d), a, b, epsabs=1e-14, limit=200)[0]
            for a, b in parts
        ]
        return sum(values)

    def profile(distance: float) -> float:
        return float(penalty.profile(np.float64(distance)))

    first = integral(profile)
    return first, integral(lambda d: (profile(d) - first) ** 2)


@pytest.mark.parametrize("penalty", PENALTIES, ids=name_of)
def test_moments_of_one_distance_equal_adaptive_quadrature(penalty, x64):
    for sd in (0.01, 0.2, 2.0):
        for z in (-3.0, -1.0, 0.0, 1.0, 4.0):
            mean = 0.2 - z * sd
            moments = distance_moments(penalty, jnp.asarray(mean), jnp.asarray(sd))
            np.testing.assert_allclose(
                moments[:2], expected(penalty, mean, sd), rtol=1e-4, atol=1e-9
            )


@pytest.mark.parametrize("penalty", PENALTIES, ids=name_of)
def test_slope_and_curvature_are_derivatives_of_the_expectation(penalty, x64):
    mean = 0.15
    step = 1e-4
    low, middle, high = (
        distance_moments(penalty, jnp.asarray(m), jnp.asarray(0.1))
        for m in (mean - step, mean, mean + step)
    )
    slope = (high.mean - low.mean) / (2 * step)
    curvature = (high.slope - low.slope) / (2 * step)
    np.testing.assert_allclose(middle.slope, slope, rtol=1e-3)
    np.testing.assert_allclose(middle.curvature, curvature, rtol=1e-2)


@pytest.mark.parametrize("penalty", PENALTIES, ids=name_of)
def test_in_float32_no_moment_is_negative_and_digits_remain(penalty, x64):
    z = np.linspace(-30, 300, 400)
    mean = 0.2 - 0.05 * z
    single = distance_moments(penalty, jnp.asarray(mean, "float32"), jnp.asarray(0.05, "float32"))
    double = distance_moments(penalty, jnp.asarray(mean), jnp.asarray(0.05))
    assert single.variance.dtype == np.float32
    assert np.all(np.asarray(single.mean) >= 0)
    assert np.all(np.asarray(single.variance) >= 0)
    near = np.abs(z) < 3
    np.testing.assert_allclose(single.mean[near], double.mean[near], rtol=2e-4)
    np.testing.assert_allclose(single.variance[near], double.variance[near], rtol=2e-3)


@pytest.mark.parametrize("penalty", PENALTIES, ids=name_of)
def test_moments_at_several_walls_equal_those_of_samples(penalty, x64, rng):
    mean = np.array([2.5, 0.5, 0.4, 0.1])
    cov = 0.25**2 * random_spd(rng, 4)
    problem = light_dark_problem(obstacles=WALLS, cost={"w_obs": 2.0, "obstacle_penalty": penalty})
    m = running_moments(problem, mean, cov)
    x = rng.multivariate_normal(mean, cov, 200_000)
    distances = x[:, :2] @ np.asarray(WALLS.normals).T - np.asarray(WALLS.offsets)
    penalties = 2.0 * np.sum(penalty.profile(jnp.asarray(distances)), axis=1)
    offsets = x - np.asarray(problem.cost.goal)
    base = 0.5 * offsets**2 @ np.asarray(problem.cost.running_weight)
    deviations = penalties - penalties.mean()
    for moment, values in [
        (m.penalty, penalties),
        (m.penalty_var, deviations**2),
        (m.covariance, deviations * (base - base.mean())),
    ]:
        assert abs(values.mean() - moment) < SIGMAS * values.std() / np.sqrt(len(x))


@pytest.mark.parametrize("penalty", PENALTIES, ids=name_of)
def test_without_spread_the_moments_are_the_penalty_itself(penalty, x64):
    problem = light_dark_problem(obstacles=WALLS, cost={"w_obs": 2.0, "obstacle_penalty": penalty})
    for mean in ([2.5, 0.5, 0, 0], [2.1, 0.9, 0, 0], [9.0, -9.0, 0, 0]):
        m = running_moments(problem, np.array(mean), np.zeros((4, 4)))
        np.testing.assert_allclose(m.penalty, problem.penalty(jnp.array(mean)), atol=1e-6)
        np.testing.assert_allclose([m.penalty_var, m.covariance], 0, atol=1e-6)


def test_walls_that_face_each_other_are_fully_correlated(x64):
    """Takes the penalties of a corridor so wide that their sum is the same everywhere."""
    corridor = mb.HalfSpaces([[0, 1], [0, -1]], [-1, -1])
    problem = light_dark_problem(
        obstacles=corridor, cost={"w_obs": 1.0, "obstacle_penalty": mb.Hinge(9.0)}
    )
    m = running_moments(problem, np.array([0, 0.3, 0, 0]), 0.01 * np.eye(4))
    np.testing.assert_allclose(m.penalty, 2 * (9.0 - 1.0), rtol=1e-9)
    assert 0 <= m.penalty_var < 1e-5


@mb.struct
class Own:
    """Represents a penalty of a user's own, which knows its profile only."""

    def profile(self, distance: Array) -> Array:
        return jnp.exp(-distance / 0.5)


def test_a_penalty_of_a_users_own_is_integrated(x64):
    wall = mb.HalfSpaces([[1, 0]], [0])
    problem = light_dark_problem(obstacles=wall, cost={"w_obs": 3.0, "obstacle_penalty": Own()})
    m = running_moments(problem, np.array([0.4, 0, 0, 0]), 0.04 * np.eye(4))
    mean = 3 * np.exp(-0.8 + 0.5 * 0.16)
    np.testing.assert_allclose(m.penalty, mean, rtol=1e-4)
    np.testing.assert_allclose(m.penalty_var, mean**2 * np.expm1(0.16), rtol=5e-3)
