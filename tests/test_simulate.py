"""The closed loop: what is random and what is not, and how a trial is judged."""

import itertools
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array
from scipy.optimize import minimize_scalar

import mppi_belief as mb
import reference
from helpers import (
    CENTERS,
    Feedback,
    Info,
    assert_covariance,
    assert_mean,
    light_dark_problem,
    quick_jit,
)
from mppi_belief.belief.prior import sample_prior
from mppi_belief.simulate import FILTER, PLANNER, PLANT, plant_step, role_key

DT = 0.1
STEPS = 20
EXACT = {"xatol": 1e-10}
MODEL = reference.light_dark(sampled=True, dt=DT)


@quick_jit
def trials(
    problem: mb.Problem, controller: mb.Controller, seed: Array | int, numbers: Array
) -> mb.Trial:
    return jax.vmap(lambda number: mb.simulate_trial(problem, mb.EKF(), controller, seed, number))(
        numbers
    )


def run(
    problem: mb.Problem,
    controller: mb.Controller,
    seed: int = 0,
    numbers: tuple[int, ...] = (0, 1, 2),
) -> mb.Trial:
    return jax.tree.map(np.asarray, trials(problem, controller, seed, jnp.array(numbers)))


@pytest.fixture
def problem() -> mb.Problem:
    return light_dark_problem(steps=STEPS)


def residuals(trial: mb.Trial) -> tuple[np.ndarray, np.ndarray]:
    """Process noise (N, T, 4), and measurement noise over its standard deviation (N, T, 2)."""
    x = trial.states[:, :-1]
    after = trial.states[:, 1:]
    process = after - x - DT * (x @ MODEL.A.T + trial.controls @ MODEL.B.T)
    sigma = np.abs(after[..., :1] - 5) / np.sqrt(2) + 0.1
    return process, (trial.measurements - after[..., :2]) / sigma


def test_a_trial_has_the_documented_shapes(problem, x64):
    trial = run(problem, Feedback(1.0))
    shapes = [np.shape(leaf) for leaf in jax.tree.leaves(trial)]
    T = STEPS
    assert shapes == [(3, T + 1, 4), (3, T + 1, 4), (3, T + 1, 4, 4), (3, T, 2), (3, T, 2), (3, T)]


def test_the_same_seed_and_trial_give_the_same_bits(problem, x64):
    controller = mb.MPPI(n_samples=8, horizon=4, sampler=mb.NominalSampler(control_std=2.75))
    first, again = (run(problem, controller) for _ in range(2))
    for a, b in zip(jax.tree.leaves(first), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(a, b)


def test_trials_and_seeds_differ(problem, x64):
    trial, second = (run(problem, Feedback(1.0), seed=seed) for seed in (0, 1))
    assert np.all(trial.states[0] != trial.states[1])
    assert np.all(trial.states != second.states)


def test_a_trials_noise_does_not_depend_on_the_other_trials(problem, x64):
    first, second = (
        run(problem, Feedback(1.0), numbers=numbers) for numbers in ((3, 4, 5), (0, 3, 7))
    )
    np.testing.assert_allclose(first.states[0], second.states[1], rtol=1e-12)


def test_common_random_numbers_whatever_the_controller(problem, x64):
    """The noise, not the path: states part, the residuals of state and measurement stay."""
    idle, busy = (run(problem, Feedback(gain)) for gain in (0.0, 2.0))
    planner = run(
        problem, mb.MPPI(n_samples=8, horizon=4, sampler=mb.NominalSampler(control_std=2.75))
    )
    for second in (busy, planner):
        np.testing.assert_array_equal(idle.states[:, 0], second.states[:, 0])
        assert np.abs(idle.states[:, -1] - second.states[:, -1]).max() > 0.1
        for ours, theirs in zip(residuals(idle), residuals(second), strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-12)


def test_roles_have_keys_of_their_own():
    keys = [
        jax.random.key_data(role_key(s, t, r))
        for s in (0, 1)
        for t in (0, 1)
        for r in (PLANT, FILTER, PLANNER)
    ]
    assert len({tuple(np.asarray(k).tolist()) for k in keys}) == 12


def test_plant_noise_has_the_distribution_of_the_model(problem, x64):
    trial = run(problem, Feedback(0.5), seed=5, numbers=tuple(range(200)))
    process, sensor = (noise.reshape(-1, noise.shape[-1]) for noise in residuals(trial))
    assert_mean(np.hstack([process[:, 2:], sensor]), 0.0)
    np.testing.assert_allclose(process[:, :2], 0, atol=1e-12)
    # process and measurement noise are independent too
    expected = np.diag([0.3**2 * DT, 0.3**2 * DT, 1, 1])
    assert_covariance(np.hstack([process[:, 2:], sensor]), expected)
    # and white: the noise of one step says nothing of the next
    pairs = np.concatenate(
        [residuals(trial)[1][:, :-1], residuals(trial)[1][:, 1:]], axis=-1
    ).reshape(-1, 4)
    assert_covariance(pairs, np.eye(4))


@pytest.mark.parametrize("convention", ["sample", "intensity"])
def test_one_step_of_the_plant_follows_the_noise_convention(convention, x64):
    problem = light_dark_problem(noise_convention=convention)
    x = jnp.array([3.0, 0.5, 1.0, -1.0])
    u = jnp.array([2.0, 0.0])
    step = quick_jit(jax.vmap(lambda key: plant_step(problem, x, u, key)))
    after, y = step(jax.random.split(jax.random.key(2), 20_000))
    assert_mean(after, [3.1, 0.4, 1.2, -1.0])
    deviation = 1.9 / np.sqrt(2) + 0.1
    assert_covariance(
        np.asarray(y - after[:, :2]),
        deviation**2 / (1 if convention == "sample" else DT) * np.eye(2),
    )


def test_initial_states_are_drawn_from_the_prior(problem, x64):
    draw = quick_jit(jax.vmap(lambda key: sample_prior(problem, key)))
    states = np.asarray(draw(jax.random.split(jax.random.key(3), 20_000)))
    assert_mean(states, problem.prior_mean)
    assert_covariance(states - problem.prior_mean, np.diag(problem.prior_std**2))


def test_beliefs_start_at_the_prior_and_follow_the_filter(problem, x64):
    trial = run(problem, Feedback(1.0))
    np.testing.assert_array_equal(trial.beliefs.mean[0, 0], problem.prior_mean)
    np.testing.assert_allclose(trial.controls, -trial.beliefs.mean[:, :-1, :2], rtol=1e-12)
    mean = trial.beliefs.mean[0, 0]
    cov = trial.beliefs.cov[0, 0]
    for k in range(STEPS):
        mean, cov = reference.kalman_step(
            mean,
            cov,
            trial.measurements[0, k],
            lambda x, k=k: x + DT * (MODEL.A @ x + MODEL.B @ trial.controls[0, k]),
            lambda x: MODEL.C @ x,
            MODEL.Q * DT,
            lambda x: MODEL.intensity(x) / DT,
        )
        np.testing.assert_allclose(trial.beliefs.mean[0, k + 1], mean, atol=1e-8)
        np.testing.assert_allclose(trial.beliefs.cov[0, k + 1], cov, atol=1e-8)


def test_metrics_equal_a_recomputation(problem, x64):
    trial = run(problem, Feedback(0.7))
    metrics_of_trials = jax.tree.map(
        np.asarray, quick_jit(jax.vmap(lambda trial: mb.metrics(problem, trial)))(trial)
    )
    goal = np.array([7.0, 0, 0, 0])
    Q = np.diag([1.5, 1.5, 0.6, 0.6])
    Q_T = np.diag([5, 5, 0.15, 0.15])
    R = 0.035 * np.eye(2)
    for i in range(3):
        x = trial.states[i]
        u = trial.controls[i]
        running = sum(
            0.5 * ((x[k] - goal) @ Q @ (x[k] - goal) + u[k] @ R @ u[k]) * DT for k in range(STEPS)
        )
        terminal = 0.5 * (x[-1] - goal) @ Q_T @ (x[-1] - goal)
        clearance = path_clearance(x[:, :2], np.array(CENTERS), 0.65)
        expected = [
            running + terminal,
            running,
            terminal,
            clearance <= 0,
            clearance,
            np.linalg.norm(x[-1, :2] - [7, 0]),
        ]
        np.testing.assert_allclose(
            [part[i] for part in metrics_of_trials][:6], np.array(expected, dtype=float), rtol=1e-9
        )
        assert metrics_of_trials.ess[i] == 1


@pytest.mark.parametrize("touched", [0, 7, STEPS])
def test_a_collision_at_any_state_counts_the_first_and_last_included(touched, problem, x64):
    """To touch the surface is to collide."""
    states = np.tile(np.array([0.0, 5.0, 0.0, 0.0]), (STEPS + 1, 1))
    assert not judge(problem, states, radius=0.65).collided
    states[touched] = [3.0, 1.5, 0, 0]
    surface, inside, outside = (judge(problem, states, radius) for radius in (0.5, 0.51, 0.49))
    assert surface.collided
    assert inside.collided
    assert not outside.collided
    assert surface.clearance == 0
    assert inside.cost == surface.cost


def path_clearance(positions: np.ndarray, centers: np.ndarray, radius: float) -> float:
    """Returns the clearance of straight steps (T+1, 2), minimised over each step numerically."""
    least = []
    for start, end in itertools.pairwise(positions):
        for center in centers:
            distance = partial(_distance_at, start, end, center)
            inside = minimize_scalar(distance, bounds=(0, 1), method="bounded", options=EXACT).fun
            least.append(min(inside, distance(0), distance(1)))
    return min(least) - radius


def _distance_at(start: np.ndarray, end: np.ndarray, center: np.ndarray, part: float) -> float:
    return float(np.linalg.norm(start + part * (end - start) - center))


@mb.struct
class Fence:
    """Represents a wall from east = 1 m on, across the way."""

    thickness: float = mb.number()

    def clearance(self, position: Array) -> Array:
        return jnp.maximum(1.0 - position[0], position[0] - 1.0 - self.thickness)


@mb.struct
class Glider:
    """Represents a controller that lets the vehicle go on as it moves."""

    def init(self, problem: mb.Problem) -> Array:
        return jnp.zeros(())

    def act(
        self, problem: mb.Problem, belief: mb.Belief, plan: Array, key: Array
    ) -> tuple[Array, Array, Info]:
        return jnp.zeros(2), plan, Info(jnp.ones(()))


def test_a_wall_that_is_flown_through_between_two_states_counts_as_a_collision(x64):
    """Flies at 3 m/s: a step is 0.3 m long, the wall 0.2 m thick, and no state lies inside."""
    rest = {"prior_mean": [0.95, 1.9, 3.0, 0.0], "prior_std": np.zeros(4), "steps": 4}
    problem = light_dark_problem({"process_noise": 0}, **rest)
    trial = mb.simulate_trial(problem, mb.EKF(), Glider(), 0, 0)
    np.testing.assert_allclose(trial.states[:3, 0], [0.95, 1.25, 1.55])
    for obstacles in (Fence(0.2), mb.Obstacles([[1.1, 1.9]], 0.1)):
        fenced = replace(problem, obstacles=obstacles)
        assert np.all(jax.vmap(fenced.clearance)(trial.states) > 0)
        judged = mb.metrics(fenced, trial)
        assert judged.collided
        assert judged.clearance == pytest.approx(-0.1, abs=fenced.collision_resolution / 2)


@quick_jit
def judge(problem: mb.Problem, states: np.ndarray, radius: float) -> mb.Metrics:
    rest = jnp.zeros((STEPS, 2))
    trial = mb.Trial(
        states, mb.Belief(states, states), controls=rest, measurements=rest, ess=jnp.ones(STEPS)
    )
    return mb.metrics(replace(problem, obstacles=mb.Obstacles(CENTERS, radius)), trial)


def test_costs_leave_the_obstacle_penalty_out(problem, x64):
    trial = jax.tree.map(lambda leaf: leaf[0], run(problem, Feedback(1.0)))
    light, heavy = (
        judge(light_dark_problem(cost={"w_obs": w}, steps=STEPS), trial.states, 0.65).cost
        for w in (0, 1e4)
    )
    assert light == heavy


def test_a_longer_trial_goes_on_from_a_shorter_one():
    short, long = (
        mb.simulate_trial(light_dark_problem(steps=steps), mb.EKF(), Feedback(0.1), 0, 0)
        for steps in (3, 6)
    )
    np.testing.assert_array_equal(long.states[:4], short.states)
