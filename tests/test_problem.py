"""Tests the problem: the position of a state, and its distance to obstacles."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import mppi_belief as mb
from helpers import CENTERS, light_dark_problem, plain_problem, random_spd
from mppi_belief.belief.cost import integrated_moments, running_moments
from mppi_belief.obstacles import ObstacleShape
from mppi_belief.problem import System
from mppi_belief.trial.scene import describe_scene
from system_helpers import pendulum

ORDER = [2, 3, 0, 1]  # of the light-dark state: the velocity first


@mb.struct
class VelocityFirst:
    """Represents the light-dark vehicle with the state [v_x, v_y, p_x, p_y]."""

    inner: mb.LightDark

    @property
    def H(self) -> Array:
        return self.inner.H[jnp.array(ORDER)]

    def f(self, x: Array) -> Array:
        return self.inner.f(x[jnp.array(ORDER)])[jnp.array(ORDER)]

    def G(self, x: Array) -> Array:
        return self.inner.G(x)[jnp.array(ORDER)]

    def c(self, x: Array) -> Array:
        return x[2:]

    def sigma_o(self, x: Array) -> Array:
        return self.inner.sigma_o(x[jnp.array(ORDER)])


@mb.struct
class Wall:
    """Represents everything beyond a value of the first component of the position."""

    edge: float = mb.number()

    def clearance(self, position: Array) -> Array:
        return self.edge - position[0]


def velocity_first() -> mb.Problem:
    """Returns the reference scenario with the velocity in front of the position."""
    problem = light_dark_problem()
    weights = ("goal", "running_weight", "terminal_weight")
    cost = replace(problem.cost, **{name: getattr(problem.cost, name)[ORDER] for name in weights})
    return replace(
        problem,
        system=VelocityFirst(problem.system),
        cost=cost,
        prior_mean=problem.prior_mean[ORDER],
        prior_std=problem.prior_std[ORDER],
        position=(2, 3),
    )


@pytest.mark.parametrize(
    ("position", "expected"),
    [(None, [5.0, 6.0, 7.0]), ((0,), [5.0]), ((0, 1), [5.0, 6.0]), ((2, 0), [7.0, 5.0])],
)
def test_the_position_is_made_of_the_components_given(position, expected):
    problem = plain_problem(
        mb.GoalObstacleCost(np.zeros(3), np.ones(3), np.ones(3), np.ones(3)), position=position
    )
    x = jnp.array([5.0, 6.0, 7.0])
    np.testing.assert_array_equal(problem.position_of(x), expected)
    np.testing.assert_array_equal(jax.jit(problem.position_of)(x), expected)


def test_a_component_that_the_state_does_not_have_is_refused():
    problem = light_dark_problem(position=(0, 4))
    with pytest.raises(ValueError, match=r"position \[0, 4\] is not in a state of 4"):
        problem.position_of(jnp.zeros(4))


def test_the_clearance_is_that_of_the_position_and_infinite_without_obstacles():
    x = jnp.array([3.0, 0.0, 9.0, 9.0])
    assert light_dark_problem().clearance(x) == pytest.approx(0.35)
    assert light_dark_problem(obstacles=None).clearance(x) == np.inf
    assert velocity_first().clearance(x[jnp.array(ORDER)]) == pytest.approx(0.35)
    assert light_dark_problem(obstacles=Wall(3.5)).clearance(x) == pytest.approx(0.5)
    assert isinstance(Wall(3.5), ObstacleShape)


def test_a_stop_of_a_pendulum_is_an_angle():
    stop = mb.Obstacles([[2.0]], 0.25)
    cost = mb.GoalObstacleCost([1, 0], [1, 1], [1, 1], [1])
    problem = mb.Problem(
        pendulum(), cost, [0, 0], [1, 1], dt=0.1, steps=1, obstacles=stop, position=(0,)
    )
    assert problem.clearance(jnp.array([1.5, 9.0])) == pytest.approx(0.25)
    assert problem.clearance(jnp.array([1.8, 0.0])) == pytest.approx(-0.05, abs=1e-6)


def test_the_order_of_the_state_changes_no_moment(x64, rng):
    problem = light_dark_problem()
    reordered = velocity_first()
    mean = np.array([2.5, 0.6, 0.3, -0.2])
    cov = 0.05 * random_spd(rng, 4)
    expected = running_moments(problem, mean, cov)
    moments = running_moments(reordered, mean[ORDER], cov[np.ix_(ORDER, ORDER)])
    np.testing.assert_allclose(moments, expected, rtol=1e-12)
    penalty = reordered.penalty(jnp.asarray(mean[ORDER]))
    np.testing.assert_allclose(penalty, problem.penalty(jnp.asarray(mean)), rtol=1e-12)


def test_a_full_weight_is_reordered_on_both_axes(x64, rng):
    problem = light_dark_problem()
    reordered = velocity_first()
    weight = random_spd(rng, 4)
    block = np.ix_(ORDER, ORDER)
    problem = replace(problem, cost=replace(problem.cost, running_weight=weight))
    cost = replace(reordered.cost, running_weight=weight[block])
    reordered = replace(reordered, cost=cost)
    mean = np.array([2.5, 0.6, 0.3, -0.2])
    cov = 0.05 * random_spd(rng, 4)
    moments = running_moments(reordered, mean[ORDER], cov[block])
    np.testing.assert_allclose(moments, running_moments(problem, mean, cov), rtol=1e-12)


def test_the_order_of_the_state_changes_no_trial(x64):
    run = jax.jit(mb.simulate_trial)
    planner = mb.MPPI(n_samples=32, horizon=6, sampler=mb.NominalSampler(control_std=2.75))
    problem = light_dark_problem(steps=10, prior_std=np.zeros(4))
    reordered = replace(velocity_first(), steps=10, prior_std=np.zeros(4))
    assert isinstance(reordered.system, System)
    trial = run(problem, mb.EKF(), planner, 0, 0)
    same = run(reordered, mb.EKF(), planner, 0, 0)
    np.testing.assert_allclose(same.states, trial.states[:, np.array(ORDER)], atol=1e-8)
    expected = jax.tree.map(float, mb.metrics(problem, trial))
    assert jax.tree.map(float, mb.metrics(reordered, same)) == pytest.approx(expected, rel=1e-6)


def test_the_scene_of_a_picture_is_that_of_the_position():
    scene = describe_scene(light_dark_problem())
    reordered = describe_scene(velocity_first())
    assert scene.pop("position") == [0, 1]
    assert reordered.pop("position") == [2, 3]
    noise = scene.pop("noise")
    np.testing.assert_allclose(reordered.pop("noise")["level"], noise["level"], rtol=1e-6)
    assert scene.pop("labels") == ["$p_x$ (m)", "$p_y$ (m)"]
    assert scene == reordered
    assert scene["obstacles"] == CENTERS


def test_a_cost_of_centres_refuses_obstacles_without():
    problem = light_dark_problem(obstacles=Wall(3.5))
    with pytest.raises(ValueError, match="needs obstacles with centers, Wall has none"):
        problem.penalty(jnp.zeros(4))
    assert describe_scene(problem)["obstacles"] == []


def test_a_cost_may_ask_for_any_obstacles_by_the_clearance(x64):
    @mb.struct
    class Danger(mb.GoalObstacleCost):
        running_moments = None

        def penalty(self, x: Array, surroundings: mb.Surroundings) -> Array:
            return jnp.exp(-surroundings.clearance(x))

    base = light_dark_problem().cost
    cost = Danger(base.goal, base.running_weight, base.terminal_weight, base.control_weight)
    problem = light_dark_problem(obstacles=Wall(3.5), position=(1, 0))
    problem = replace(problem, cost=cost)
    x = jnp.array([0.0, 3.0, 0.0, 0.0])
    assert problem.penalty(x) == pytest.approx(np.exp(-0.5))
    # E[exp(p)] = exp(mean + variance / 2) for a Gaussian p
    moments = integrated_moments(problem, x, 0.01 * jnp.eye(4))
    assert moments.penalty == pytest.approx(np.exp(-0.5 + 0.005), rel=1e-6)
