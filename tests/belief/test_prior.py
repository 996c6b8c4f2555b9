"""Where a trial and its filter start, in both readings of the initial draw."""

import re
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import mppi_belief as mb
from cli_helpers import CONF, PLANNER, SMALL, compose
from experiment_helpers import compiled_quickly
from helpers import Info, assert_covariance, assert_mean, light_dark_problem, quick_jit
from mppi_belief.belief.prior import draw_start, prior
from mppi_belief.simulate import INITIAL_DRAW, PLANT, role_key
from mppi_belief.trial import build, check, run_trials, time_steps
from mppi_belief.trial.scene import describe_scene

KEY = jax.random.key(5)
STD = np.array([0.2, 0.3, 0.05, 0.1])
MODES = np.array([[0.0, 1.5, 0, 0], [0.5, -1.0, 0.2, 0]])
FILTERS = sorted(path.stem for path in CONF.glob("filter/*.yaml"))
CONTROLLERS = sorted(path.stem for path in CONF.glob("controller/*.yaml"))


def drawn(draw: str, **changes: Any) -> mb.Problem:
    return light_dark_problem(prior_std=STD, initial_draw=draw, **changes)


def starts(problem: mb.Problem, count: int) -> tuple[np.ndarray, np.ndarray]:
    """True states (count, 4) and the filters' first prior means (count, 4)."""

    def both(key: Array) -> tuple[Array, Array]:
        start = draw_start(problem, key)
        return start.state, jnp.asarray(start.problem.prior_mean)

    states, means = quick_jit(jax.vmap(both))(jax.random.split(KEY, count))
    return np.asarray(states), np.asarray(means)


@pytest.mark.parametrize("modes", [None, MODES])
def test_both_readings_have_the_same_error_of_estimation_from_the_same_numbers(modes, x64):
    count = 20_000
    states, means = starts(drawn("state", prior_modes=modes), count)
    fixed_states, drawn_means = starts(drawn("mean", prior_modes=modes), count)
    centers = np.zeros((1, 4)) if modes is None else modes
    mean = np.array([1.0, 1, 0, 0])

    # The true start is one of the modes, the same in both readings, and one alone without them.
    np.testing.assert_array_equal(means, np.broadcast_to(mean, means.shape))
    chosen = np.argmin(np.abs(fixed_states[:, None] - mean - centers).sum(axis=-1), axis=1)
    np.testing.assert_array_equal(fixed_states, mean + centers[chosen])

    # The errors are the same draws, and have the prior's covariance.
    errors = states - means - centers[chosen]
    np.testing.assert_allclose(fixed_states - drawn_means - centers[chosen], errors, atol=1e-14)
    assert_mean(errors, np.zeros(4))
    assert_covariance(errors, np.diag(STD**2))


def test_nothing_is_drawn_where_the_start_is_known(x64):
    states, means = starts(drawn("none"), 20)
    np.testing.assert_array_equal(states, np.broadcast_to([1.0, 1, 0, 0], (20, 4)))
    np.testing.assert_array_equal(means, states)
    np.testing.assert_allclose(prior(drawn("none")).cov, np.diag(STD**2))


def test_a_mode_is_drawn_where_the_start_is_known(x64):
    states, means = starts(drawn("none", prior_modes=MODES), 200)
    fixed_states, _ = starts(drawn("mean", prior_modes=MODES), 200)
    np.testing.assert_array_equal(states, fixed_states)
    np.testing.assert_array_equal(means, np.broadcast_to([1.0, 1, 0, 0], (200, 4)))
    assert len(np.unique(states[:, 1])) == 2


@pytest.mark.parametrize("draw", ["state", "mean"])
def test_the_first_squared_error_is_chi_square(draw, x64):
    """NEES of the first belief: mean 4, variance 8."""
    problem = drawn(draw)

    def nees(key: Array) -> Array:
        start = draw_start(problem, key)
        belief = prior(start.problem)
        error = start.state - belief.mean
        return error @ jnp.linalg.solve(belief.cov, error)

    values = np.asarray(quick_jit(jax.vmap(nees))(jax.random.split(KEY, 20_000)))
    assert_mean(values, 4.0)
    assert_mean((values - 4.0) ** 2, 8.0)


def moments_of(filter: mb.Filter, problem: mb.Problem) -> mb.Belief:
    belief = filter.init(problem, KEY)
    return mb.Belief(belief.mean, belief.cov)


@pytest.mark.parametrize("option", FILTERS)
def test_every_filter_starts_from_the_moved_prior(option, x64):
    """It is as wide as before, and its mean misses the true start by the drawn error."""
    filter = build(compose(f"filter={option}", "system=two_lanes")).filter
    problem = drawn("mean", prior_modes=MODES)
    moved = draw_start(problem, KEY).problem
    error = np.asarray(problem.prior_mean) - moved.prior_mean
    assert np.all(error != 0)
    first = quick_jit(lambda problem: moments_of(filter, problem))
    before, after = (first(each) for each in (problem, moved))
    np.testing.assert_allclose(after.mean, before.mean - error, rtol=1e-12)
    np.testing.assert_allclose(after.cov, before.cov, atol=1e-12)


@mb.struct
class PriorSeeker:
    """Moves against the mean of the prior that it was given before the first step."""

    def init(self, problem: mb.Problem) -> Array:
        return jnp.asarray(problem.prior_mean)

    def act(
        self, problem: mb.Problem, belief: mb.Belief, plan: Array, key: Array
    ) -> tuple[Array, Array, Info]:
        u = plan[:2] + problem.prior_mean[2:]
        return u, plan, Info(jnp.ones(()))


def test_a_trial_starts_at_the_prior_mean_which_no_controller_is_given(x64):
    problem = drawn("mean", steps=2)
    simulate = quick_jit(mb.simulate_trial)
    trial = jax.tree.map(np.asarray, simulate(problem, mb.EKF(), PriorSeeker(), 0, 3))
    start = draw_start(problem, jax.random.fold_in(role_key(0, 3, PLANT), INITIAL_DRAW))
    first = trial.beliefs.mean[0]
    np.testing.assert_array_equal(trial.states[0], problem.prior_mean)
    np.testing.assert_allclose(first, start.problem.prior_mean, rtol=1e-12)
    np.testing.assert_allclose(trial.beliefs.cov[0], np.diag(STD**2), atol=1e-15)
    np.testing.assert_allclose(trial.controls, [first[:2] + first[2:]] * 2, rtol=1e-12)
    assert np.all(np.abs(first - trial.states[0]) > 1e-4)


@pytest.mark.parametrize("option", CONTROLLERS)
def test_every_controller_starts_from_a_moved_prior_as_from_any_other(option):
    text = (CONF / "controller" / f"{option}.yaml").read_text()
    needs = re.search(r"^# needs: (.+)$", text, re.MULTILINE)
    others = needs[1].split() if needs else []
    parts = build(compose(f"controller={option}", *others, "++problem.initial_draw=mean", *PLANNER))
    moved = draw_start(parts.problem, KEY).problem
    usual, after = (
        jax.eval_shape(parts.controller.init, problem) for problem in (parts.problem, moved)
    )
    assert jax.tree.map(jnp.shape, usual) == jax.tree.map(jnp.shape, after)


def test_rows_paths_scenes_and_times_follow_the_reading():
    config = compose("controller=lqg", "++problem.initial_draw=mean", *SMALL)
    check(config)
    with compiled_quickly():
        batch = run_trials(config, [0, 1])
        assert [row["status"] for row in batch.rows] == ["ok", "ok"]
        assert len(time_steps(config, 4)) == 4
    first, second = (step for step in batch.paths if step["step"] == 0)
    start = np.asarray(config["problem"]["prior_mean"], np.float32)
    np.testing.assert_array_equal([first["state"], second["state"]], [start, start])
    assert len({float(start[0]), float(first["mean"][0]), float(second["mean"][0])}) == 3
    np.testing.assert_array_equal(describe_scene(build(config).problem)["start"], start)


def test_another_reading_is_refused_by_name():
    with pytest.raises(
        ValueError, match="initial_draw must be one of state, mean, none, got 'filter'"
    ):
        drawn("filter")
