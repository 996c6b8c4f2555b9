"""Trajectory optimisation: exact on LQ problems, monotone, stationary where it stops."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb
from helpers import light_dark_problem, quick_jit
from linear_system import lqr, random_problem
from mppi_belief.belief.cost import certainty_equivalent
from mppi_belief.planning import ilqr, lq_problem
from user_parts import Fare

SETTINGS = ilqr.ILQRSettings(
    tolerance=1e-9, max_iterations=100, damping=1e-6, damping_factor=4.0, damping_max=1e8
)


def objective(problem: mb.Problem, horizon: int, at_step_end: bool = True):
    return ilqr.state_cost(
        problem, lambda x: certainty_equivalent(problem, x), horizon, at_step_end
    )


@partial(quick_jit, static_argnames=("horizon", "at_step_end"))
def _solve(
    problem: mb.Problem, start, settings: ilqr.ILQRSettings, horizon: int, at_step_end: bool
) -> ilqr.ILQRSolution:
    return ilqr.solve(
        problem,
        objective(problem, horizon, at_step_end),
        ilqr.uncontrolled(problem, horizon),
        start,
        settings,
    )


def solve(
    problem: mb.Problem,
    start,
    settings: ilqr.ILQRSettings = SETTINGS,
    horizon: int = 30,
    at_step_end: bool = True,
) -> ilqr.ILQRSolution:
    return _solve(problem, jnp.asarray(start), settings, horizon, at_step_end)


def taxi_problem(smoothing: float = 0.0) -> mb.Problem:
    """A point that pays for its distance to the goal, at which it starts."""
    system = mb.Linear(np.zeros((2, 2)), np.eye(2), np.eye(2), 0.1 * np.eye(2), [0.2, 0.2])
    cost = Fare([0.0, 0.0], smoothing)
    return mb.Problem(system, cost, prior_mean=[0, 0], prior_std=[0.1, 0.1], dt=0.1, steps=20)


@quick_jit
def closed_loops(problem: mb.Problem, controller: mb.EKFiLQG) -> mb.Trial:
    """Four trials."""
    return jax.vmap(lambda i: mb.simulate_trial(problem, mb.EKF(), controller, 0, i))(jnp.arange(4))


@pytest.mark.parametrize("at_step_end", [False, True])
def test_one_iteration_solves_a_linear_quadratic_problem(at_step_end, x64, rng):
    problem = random_problem(rng)
    horizon = 12
    start = np.asarray(problem.prior_mean) + 1.0
    once = SETTINGS._replace(max_iterations=1)
    computed = solve(problem, start, once, horizon, at_step_end)
    charged = np.ones(horizon + 1)
    charged[0 if at_step_end else -1] = 0
    np.testing.assert_allclose(
        computed.policy.controls, lqr(problem, start, charged), rtol=1e-8, atol=1e-8
    )


def test_the_gains_are_the_derivative_of_the_optimal_control(x64, rng):
    problem = random_problem(rng)
    start = np.array([0.4, -0.2, 0.7])
    horizon = 12
    charged = np.ones(horizon + 1)
    charged[0] = 0
    computed = solve(problem, start, horizon=horizon)
    for direction in np.eye(3):
        moved = lqr(problem, start + direction, charged)[0] - lqr(problem, start, charged)[0]
        np.testing.assert_allclose(
            computed.policy.gains[0] @ direction, moved, rtol=1e-8, atol=1e-8
        )


@pytest.mark.parametrize(
    "start", [[1.0, 1.0, 0.0, 0.0], [2.0, -0.9, 1.0, 0.3], [3.0, 0.95, 0.0, 0.0]]
)
def test_cost_never_rises_from_one_iteration_to_the_next(start, light_dark, x64):
    costs = [
        float(solve(light_dark, start, settings=SETTINGS._replace(max_iterations=count)).cost)
        for count in range(1, 16)
    ]
    assert np.all(np.diff(costs) <= 1e-12)
    assert costs[-1] < costs[0]  # there was something to improve: the penalty is not quadratic


@pytest.mark.parametrize(
    "start", [[1.0, 1.0, 0.0, 0.0], [2.0, -0.9, 1.0, 0.3], [5.0, 3.0, -1.0, 0.0]]
)
def test_the_solution_is_stationary(start, light_dark, x64):
    computed = solve(light_dark, start)
    assert computed.converged
    cost = objective(light_dark, 30)

    def value(controls):
        open_loop = computed.policy._replace(
            controls=controls, gains=jnp.zeros_like(computed.policy.gains)
        )
        return ilqr.total_cost(
            light_dark, cost, ilqr.forward_rollout(light_dark, open_loop, jnp.asarray(start))
        )

    np.testing.assert_allclose(
        quick_jit(value)(computed.policy.controls), computed.cost, rtol=1e-10
    )
    gradient = quick_jit(jax.grad(value))
    at_rest = np.linalg.norm(gradient(jnp.zeros((30, 2))))
    assert np.linalg.norm(gradient(computed.policy.controls)) < 1e-3 * at_rest


def test_an_indefinite_hessian_is_projected_to_the_nearest_psd_matrix(x64, rng):
    values = np.array([2.0, -1.0, 0.5])
    basis, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    projected = lq_problem.nearest_psd(jnp.asarray(basis @ np.diag(values) @ basis.T))
    np.testing.assert_allclose(projected, basis @ np.diag([2.0, 0.0, 0.5]) @ basis.T, atol=1e-12)


def test_a_rollout_of_a_policy_from_elsewhere_uses_its_feedback(x64, rng):
    problem = random_problem(rng)
    policy = ilqr.uncontrolled(problem, 4)._replace(gains=jnp.ones((4, 2, 3)))
    away = jnp.asarray(problem.prior_mean) + 0.1
    followed = quick_jit(ilqr.forward_rollout)(problem, policy, away)
    np.testing.assert_allclose(followed.controls[0], np.full(2, 0.3), rtol=1e-12)


def test_a_warm_start_is_the_same_policy_one_step_later(x64, light_dark):
    policy = solve(light_dark, [1.0, 1.0, 0.0, 0.0]).policy
    later = ilqr.warm_start(policy)
    np.testing.assert_array_equal(later.controls[:-1], policy.controls[1:])
    np.testing.assert_array_equal(later.states[:-1], policy.states[1:])
    assert not later.controls[-1].any()
    assert not later.gains[-1].any()


@pytest.mark.parametrize("w_obs", [0.0, 500.0, 1e4, 1e8])
def test_the_closed_loop_stays_finite_in_float32_through_many_iterations(w_obs):
    problem = light_dark_problem(cost={"w_obs": w_obs}, steps=25)
    trials = closed_loops(problem, mb.EKFiLQG(horizon=20, tolerance=1e-12))
    assert np.all(np.isfinite(trials.states))
    assert np.all(np.isfinite(trials.controls))


@pytest.mark.parametrize("smoothing", [0.0, 1e-3])
def test_a_distance_without_derivatives_at_the_goal_leads_there(smoothing):
    """The prior mean is the goal itself, so the first expansion is about the kink."""
    problem = taxi_problem(smoothing)
    trials = closed_loops(problem, mb.EKFiLQG(horizon=10))
    assert np.all(np.isfinite(trials.states))
    assert np.all(np.isfinite(trials.controls))
    plan = solve(problem, [1.0, -0.5], horizon=10).policy
    assert np.linalg.norm(plan.states[-1]) < 0.1


def test_a_plan_at_the_kink_of_a_distance_stays_there(x64):
    plan = solve(taxi_problem(), [0.0, 0.0], horizon=10)
    assert plan.converged
    np.testing.assert_array_equal(plan.policy.states, np.zeros((11, 2)))
    assert np.all(np.isfinite(plan.policy.gains))


def test_derivatives_that_overflow_leave_a_finite_plan():
    problem = taxi_problem(smoothing=1e-18)
    plan = solve(problem, [0.0, 0.0], horizon=10).policy
    assert all(np.all(np.isfinite(part)) for part in plan)
