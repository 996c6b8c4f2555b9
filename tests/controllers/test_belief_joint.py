"""MPPI-Belief with a covariance for every path: where it must be MPPI-Belief itself, and where it
must not.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import mppi_belief as mb
from helpers import light_dark_problem, quick_jit
from mppi_belief.belief import cost as belief_cost
from mppi_belief.belief import gaussian as gaussians
from mppi_belief.belief import kalman as belief
from mppi_belief.belief.prior import prior
from mppi_belief.planning.parts import PlanInfo

KEY = jax.random.key(7)
THETA = 0.7
SHARED = mb.MPPI(32, 6, 30.0, mb.RiskSensitive(THETA), mb.NominalSampler(control_std=1.0))
SMALL = replace(SHARED, schedule=mb.PerPathCovariance())
PLAN = 0.3 * jax.random.normal(jax.random.key(1), (6, 2))


@quick_jit
def act(
    problem: mb.Problem, controller: mb.Controller, plan: Array = PLAN
) -> tuple[Array, Array, PlanInfo]:
    return controller.act(problem, prior(problem), plan, KEY)


@quick_jit
def state_costs(problem: mb.Problem, controls: Array) -> tuple[Array, Array]:
    start = gaussians.RootBelief(
        jnp.asarray(problem.prior_mean), jnp.diag(jnp.asarray(problem.prior_std))
    )
    planned = SMALL.schedule.plan(problem, SMALL.path_cost, start, controls[:, :, 0])
    return planned.costs(controls, None)


def test_where_the_sensor_is_the_same_everywhere_it_is_mppi_belief(x64):
    """The covariance of a linear system then depends on no path."""
    blind = light_dark_problem(system={"noise_slope": 0})
    for at_step_end, points in ((True, 1), (False, 1), (True, 3), (False, 2)):
        path_cost = mb.RiskSensitive(THETA, at_step_end=at_step_end, points_per_step=points)
        own, shared = (act(blind, replace(c, path_cost=path_cost)) for c in (SMALL, SHARED))
        for a, b in zip(jax.tree.leaves(own), jax.tree.leaves(shared), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)


def test_in_the_light_and_the_dark_it_is_not(x64):
    looking = light_dark_problem(
        system={"light": 1.5, "noise_slope": 4}, prior_std=[1, 1, 0.05, 0.05]
    )
    own, shared = (act(looking, c) for c in (SMALL, SHARED))
    assert np.abs(own[0] - shared[0]).max() > 1e-3
    np.testing.assert_allclose(own[2].planned_cov, shared[2].planned_cov, rtol=1e-12, atol=1e-15)


def test_each_path_is_charged_for_the_belief_that_its_own_filter_would_have(x64):
    """Path by path with the filter itself, given the measurements that it expects."""
    problem = light_dark_problem()
    theta = THETA
    controls = jax.random.normal(KEY, (6, 2, 2))
    costs, means = state_costs(problem, controls)
    for i in range(2):
        planned = prior(problem)
        total = 0.0
        for k in range(6):
            predicted = belief.predict(problem, planned, controls[k, :, i])
            planned = belief.correct(problem, predicted, problem.system.c(predicted.mean)).posterior
            np.testing.assert_allclose(means[k, :, i], planned.mean, rtol=1e-12)
            total += (
                belief_cost.risk_sensitive(problem, planned.mean, planned.cov, theta) * problem.dt
            )
        total += belief_cost.expected_terminal(problem, planned.mean, planned.cov)
        np.testing.assert_allclose(costs[i], total, rtol=1e-9)


def test_a_path_to_the_light_costs_less_than_the_shared_covariance_says(x64):
    """Two ways of the same length: the one through the light is the cheaper one."""
    problem = light_dark_problem(
        cost={"goal": [4, 0, 0, 0], "w_obs": 0},
        prior_mean=[4.0, 0, 0, 0],
        prior_std=[1, 1, 0.01, 0.01],
    )
    push = jnp.stack([jnp.array([u, 0.0]) for u in (6.0, -6.0)], axis=1)
    controls = jnp.stack([push, push, -push, -push, -push, push])
    (light, dark), _ = state_costs(problem, controls)
    assert light < dark - 0.1


def test_a_step_without_a_finite_path_keeps_the_plan():
    control, carried, info = act(light_dark_problem(cost={"terminal_weight": [3e38] * 4}), SMALL)
    np.testing.assert_array_equal(control, PLAN[0])
    np.testing.assert_array_equal(carried[:-1], PLAN[1:])
    assert info.ess == 0
