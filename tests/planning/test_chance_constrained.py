"""The chance constraint: its margin, its level, its limits, mixtures, and every kind of penalty."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import ncx2, norm

import mppi_belief as mb
from cli_helpers import compose
from helpers import light_dark_problem, random_spd
from mppi_belief.belief.cost import expected_base, mixture_terminal
from mppi_belief.belief.gaussian import MixtureBelief
from mppi_belief.belief.prior import prior
from mppi_belief.errors import ConfigError
from mppi_belief.trial import check

MEAN = jnp.array([2.1, 0.5, 0.3, -0.2])
HINGE = mb.Hinge(0.13)
CHANCE = mb.ChanceConstrained(0.0228)


def hinge_problem(**problem) -> mb.Problem:
    return light_dark_problem(cost={"obstacle_penalty": HINGE}, **problem)


def widened(problem: mb.Problem, reach: float) -> mb.Problem:
    """Returns the problem with larger discs."""
    obstacles = problem.obstacles
    assert isinstance(obstacles, mb.Obstacles)
    return replace(problem, obstacles=replace(obstacles, radius=obstacles.radius + reach))


def random_cov(rng: np.random.Generator) -> jnp.ndarray:
    return jnp.asarray(0.04 * random_spd(rng, 4, 0.1, 2.0))


@pytest.mark.parametrize("level", [0.5, 0.3, 0.0228, 1e-3, 1e-9])
@pytest.mark.parametrize("steps", [1, 30])
def test_deviations_are_the_quantile_of_the_level_of_a_step(level, steps):
    deviations = mb.ChanceConstrained(level, joint_steps=steps).deviations
    np.testing.assert_allclose(deviations, norm.isf(level / steps), rtol=2e-6, atol=1e-7)


def test_two_standard_deviations_are_the_default():
    np.testing.assert_allclose(mb.ChanceConstrained().deviations, 2, atol=1e-3)


@pytest.mark.parametrize("penalty", [HINGE, mb.SquaredHinge(0.13), mb.SmoothStep(0.3)])
def test_the_penalty_is_that_of_larger_discs_at_the_mean(penalty, x64, rng):
    problem = light_dark_problem(cost={"obstacle_penalty": penalty})
    cov = random_cov(rng)
    reach = norm.isf(0.0228) * np.sqrt(np.linalg.eigvalsh(cov[:2, :2])[-1])
    expected = expected_base(problem, MEAN, cov) + widened(problem, reach).penalty(MEAN)
    assert expected > expected_base(problem, MEAN, cov) + problem.penalty(MEAN)
    np.testing.assert_allclose(CHANCE.running(problem, MEAN, cov), expected, rtol=1e-12)


def test_components_of_the_position_may_be_anywhere_in_the_state(x64, rng):
    """Swapping positions and velocities of the state changes nothing."""
    order = np.array([2, 3, 1, 0])
    problem = hinge_problem()
    cov = random_cov(rng)
    cost = problem.cost
    assert isinstance(cost, mb.GoalObstacleCost)
    turned = replace(
        cost,
        goal=jnp.asarray(cost.goal)[order],
        running_weight=jnp.asarray(cost.running_weight)[order],
    )
    moved = replace(problem, cost=turned, position=(3, 2))
    np.testing.assert_allclose(
        CHANCE.running(moved, MEAN[order], cov[order][:, order]),
        CHANCE.running(problem, MEAN, cov),
        rtol=1e-12,
    )


def test_a_certain_belief_costs_what_it_costs_a_certainty_equivalent_planner(x64):
    problem = hinge_problem()
    certain = mb.CertaintyEquivalent()
    none = jnp.zeros((4, 4))
    for mean in (MEAN, MEAN + 3):
        assert CHANCE.running(problem, mean, none) == certain.running(problem, mean, none)
        assert CHANCE.terminal(problem, mean, none) == certain.terminal(problem, mean, none)


def test_a_level_of_one_half_is_the_penalty_at_the_mean(x64, rng):
    problem = hinge_problem()
    cov = random_cov(rng)
    neutral = mb.RiskSensitive(expectation="at_mean")
    half = mb.ChanceConstrained(0.5)
    expected = neutral.running(problem, MEAN, cov)
    np.testing.assert_allclose(half.running(problem, MEAN, cov), expected, rtol=1e-12)


@pytest.mark.parametrize("radius", [0.1, 0.65, 100.0])
def test_the_probability_of_being_inside_a_disc_keeps_to_the_level(radius):
    """At the border of the enlarged disc it is less, and for a straight wall it is the level."""
    deviation = 0.2
    level = 0.05
    distance = float(mb.ChanceConstrained(level).deviations) * deviation
    noncentrality = ((radius + distance) / deviation) ** 2
    inside = ncx2.cdf((radius / deviation) ** 2, 2, noncentrality)
    assert inside < level
    if radius == 100:
        np.testing.assert_allclose(inside, level, rtol=5e-3)


def test_any_shape_with_a_clearance_is_enlarged(x64, rng):
    @mb.struct
    class Wall:
        edge: float = mb.number()

        def clearance(self, position: jax.Array) -> jax.Array:
            return self.edge - position[0]

    cov = random_cov(rng)
    problem = hinge_problem()
    reach = CHANCE.deviations * np.sqrt(np.linalg.eigvalsh(cov[:2, :2])[-1])
    charged = CHANCE.running(replace(problem, obstacles=Wall(2.2)), MEAN, cov)
    nearer = replace(problem, obstacles=Wall(2.2 - reach))
    expected = expected_base(problem, MEAN, cov) + nearer.penalty(MEAN)
    np.testing.assert_allclose(charged, expected, rtol=1e-6)


def test_a_bump_is_the_highest_within_the_margin(x64):
    problem = light_dark_problem()
    centers = np.asarray(problem.obstacles.centers)
    deviation = 0.15
    cov = jnp.diag(jnp.array([deviation, deviation, 0.1, 0.1]) ** 2)
    reach = float(CHANCE.deviations) * deviation
    base_free = replace(problem, cost=replace(problem.cost, running_weight=jnp.zeros(4)))
    charge = jax.jit(lambda mean: CHANCE.running(base_free, mean, cov))
    for position in ([2.1, 0.5], [2.9, 0.9]):
        distances = np.linalg.norm(np.array(position) - centers, axis=1)
        depths = np.maximum(distances - reach, 0)
        expected = 500 * np.sum(np.exp(-(depths**2) / (2 * 0.285**2)))
        mean = jnp.array([*position, 0.3, 0.1])
        np.testing.assert_allclose(charge(mean), expected, rtol=1e-6)

    # At a centre its gradient is that of the other bump.
    gradient = jax.grad(charge)(jnp.array([*centers[0], 0.0, 0.0]))
    assert np.all(np.isfinite(gradient))


def test_without_obstacles_there_is_no_penalty(x64, rng):
    problem = hinge_problem(obstacles=None)
    cov = random_cov(rng)
    charged = CHANCE.running(problem, MEAN, cov)
    np.testing.assert_allclose(charged, expected_base(problem, MEAN, cov), rtol=1e-12)


def test_components_of_a_mixture_have_margins_of_their_own(x64, rng):
    problem = hinge_problem()
    weights = jnp.array([0.3, 0.7])
    means = jnp.stack([MEAN, MEAN + jnp.array([0.0, -0.4, 0.0, 0.0])])
    covs = jnp.stack([random_cov(rng), random_cov(rng)])
    each = [CHANCE.running(problem, m, S) for m, S in zip(means, covs, strict=True)]
    charged = CHANCE.mixture_running(problem, weights, means, covs)
    np.testing.assert_allclose(charged, np.dot(weights, np.array(each)), rtol=1e-12)
    np.testing.assert_allclose(
        CHANCE.mixture_terminal(problem, weights, means, covs),
        mixture_terminal(problem, weights, means, covs),
        rtol=1e-12,
    )

    # The planner asks for it: a belief of one mode is planned from as that mode.
    root = jnp.diag(jnp.asarray(problem.prior_std))
    start = jnp.asarray(problem.prior_mean)
    mixed = MixtureBelief(start[None], root[None], jnp.zeros(1))
    controls = jnp.zeros((3, 2))
    shared = mb.SharedCovariance()
    np.testing.assert_allclose(
        shared.plan(problem, CHANCE, mixed, controls).nominal_cost,
        shared.plan(problem, CHANCE, prior(problem), controls).nominal_cost,
        rtol=1e-9,
    )


def test_a_covariance_per_path_gives_the_nominal_the_same_cost(x64):
    problem = hinge_problem(prior_mean=[2.0, 0.6, 0.5, 0.0])
    controls = jnp.asarray(np.random.default_rng(2).normal(size=(4, 2)))
    planned = mb.PerPathCovariance().plan(problem, CHANCE, prior(problem), controls)
    assert (
        planned.nominal_cost
        > mb.PerPathCovariance()
        .plan(problem, mb.ChanceConstrained(0.5), prior(problem), controls)
        .nominal_cost
    )
    np.testing.assert_allclose(planned.nominal_cost, planned.moments.nominal_cost, rtol=1e-9)


@pytest.mark.parametrize(
    ("word", "reason"),
    [
        ("level=0", "controller.path_cost.level must be greater than 0.*got 0"),
        ("level=0.6", "controller.path_cost.level must be at most 0.5, got 0.6"),
        ("level=2", "controller.path_cost.level must be at most 0.5, got 2"),
        ("level=null", "controller.path_cost.level must be a number, got None"),
        ("joint_steps=0", "controller.path_cost.joint_steps must be at least 1, got 0"),
    ],
)
def test_bad_numbers_are_refused_in_one_line(word, reason):
    with pytest.raises(ConfigError, match=reason) as raised:
        check(compose("controller=chance", f"controller.path_cost.{word}"))
    assert "\n" not in str(raised.value)


def test_the_level_can_be_that_of_the_whole_horizon():
    config = compose("controller=chance", "controller.path_cost.joint_steps=${planner.horizon}")
    assert config["controller"]["path_cost"]["joint_steps"] == config["planner"]["horizon"]
