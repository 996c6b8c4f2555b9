"""The controller's options, limits and diagnostics."""

from dataclasses import replace
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import mppi_belief as mb
from helpers import assert_covariance, light_dark_problem, quick_jit
from mppi_belief.belief import cost as belief_cost
from mppi_belief.belief.prior import prior
from mppi_belief.belief.schedule import gain_schedule
from mppi_belief.planning import path_integral, path_weights
from mppi_belief.planning.parts import PlanInfo

KEY = jax.random.key(7)
# one shape for nearly all tests, so that they share what has been compiled
SMALL = mb.MPPI(
    n_samples=32,
    horizon=6,
    temperature=30.0,
    path_cost=mb.RiskSensitive(theta=0.7),
    sampler=mb.NominalSampler(control_std=1.0, antithetic=True),
)
CERTAIN = replace(SMALL, path_cost=mb.CertaintyEquivalent())


@quick_jit
def act_on(
    problem: mb.Problem, controller: mb.MPPI, plan: Array, key: Array
) -> tuple[Array, Array, PlanInfo]:
    return controller.act(problem, prior(problem), plan, key)


def act(
    controller: mb.MPPI, problem: mb.Problem, plan: Array | None = None, key: Array = KEY
) -> tuple[Array, Array, PlanInfo]:
    """One step from the prior, on the zero nominal unless another is given."""
    return act_on(
        problem, controller, controller.init(problem) if plan is None else jnp.asarray(plan), key
    )


def test_certainty_equivalence_is_belief_planning_with_nothing_uncertain(x64):
    near = {"prior_mean": [2.3, 0.8, 0.5, 0]}
    certain = light_dark_problem(system={"process_noise": 0}, prior_std=[0, 0, 0, 0], **near)
    neutral = replace(SMALL, path_cost=mb.RiskSensitive())
    belief, mean = (act(controller, certain) for controller in (neutral, CERTAIN))
    np.testing.assert_allclose(belief[0], mean[0], rtol=1e-10)
    np.testing.assert_allclose(belief[2].ess, mean[2].ess, rtol=1e-10)
    # where something is uncertain, they part
    uncertain = light_dark_problem(**near)
    belief, mean = (act(controller, uncertain) for controller in (neutral, CERTAIN))
    assert np.abs(belief[0] - mean[0]).max() > 1e-3


def test_certainty_equivalence_has_no_theta():
    with pytest.raises(TypeError, match="theta"):
        mb.CertaintyEquivalent(theta=5.0)


def test_one_trace_serves_every_theta_temperature_and_weight():
    traces = []

    @quick_jit
    def step(problem: mb.Problem, controller: mb.MPPI) -> Array:
        traces.append(controller)
        return controller.act(problem, prior(problem), controller.init(problem), KEY)[0]

    controls = [
        step(
            light_dark_problem(cost={"w_obs": w_obs}),
            mb.MPPI(16, 5, 10 * theta + 1, mb.RiskSensitive(theta), mb.NominalSampler(2.75)),
        )
        for theta, w_obs in ((0.0, 100), (0.5, 500), (5.0, 1e4))
    ]
    assert len(traces) == 1
    assert len({tuple(u.tolist()) for u in controls}) == 3


def test_diagnostics(light_dark, x64, rng):
    nominal = rng.normal(size=(6, 2))
    running_moments = quick_jit(belief_cost.running_moments)
    schedule = quick_jit(gain_schedule)(light_dark, prior(light_dark), jnp.asarray(nominal))
    for at_step_end in (False, True):
        path_cost = mb.RiskSensitive(theta=0.7, at_step_end=at_step_end)
        _, _, info = act(replace(SMALL, path_cost=path_cost), light_dark, nominal)
        np.testing.assert_allclose(info.planned_cov, schedule.cov, atol=1e-14)
        assert info.planned_cov.shape == (7, 4, 4)
        assert 1 <= info.ess <= 32
        total = light_dark.cost.terminal_mean(schedule.mean[6], schedule.cov[6])
        for k in range(1, 7) if at_step_end else range(6):
            m = running_moments(light_dark, schedule.mean[k], schedule.cov[k])
            total += (m.base + m.penalty + 0.35 * m.penalty_var) * 0.1
        np.testing.assert_allclose(info.nominal_cost, total, rtol=1e-12)


def test_a_penalty_between_two_states_is_charged_where_a_step_has_more_points(x64):
    """Moves at 8 m/s over a bump that is much narrower than a step of 0.8 m."""
    problem = light_dark_problem(
        cost={"obstacle_penalty": mb.Bump(0.05), "w_obs": 1e3},
        obstacles=mb.Obstacles([[0.4, 0.0]], 0.05),
        prior_mean=[0.0, 0.0, 8.0, 0.0],
    )
    free = replace(problem, obstacles=None)

    def penalty(points: int) -> float:
        path_cost = mb.CertaintyEquivalent(points_per_step=points)
        planner = replace(SMALL, path_cost=path_cost)
        costs = [act(planner, each, np.zeros((6, 2)))[2].nominal_cost for each in (problem, free)]
        return float(costs[0] - costs[1])

    # The time within the bump, sqrt(2 pi) width / speed, times its height.
    assert penalty(1) == pytest.approx(0, abs=1e-9)
    assert penalty(64) == pytest.approx(1e3 * np.sqrt(2 * np.pi) * 0.05 / 8, rel=1e-6)


def test_the_plan_is_the_improved_nominal_moved_up_by_one_step(light_dark, x64, rng):
    nominal = rng.normal(size=(6, 2))
    u, plan, info = act(replace(SMALL, temperature=1e12), light_dark, nominal)
    # at a huge temperature all samples count the same, and mirrored ones cancel
    np.testing.assert_allclose(info.ess, 32, rtol=1e-6)
    np.testing.assert_allclose(u, nominal[0], atol=1e-6)
    np.testing.assert_allclose(plan, np.vstack([nominal[1:], np.zeros((1, 2))]), atol=1e-6)


def test_at_zero_temperature_the_best_sample_is_taken(light_dark, x64):
    controller = replace(CERTAIN, temperature=1e-6)
    u, _, info = act(controller, light_dark)
    samples = jnp.moveaxis(path_integral.normals(KEY, (6, 2, 32), True), -1, 0)
    # each sample's cost is that of the nominal which it would be
    best = np.argmin([act(controller, light_dark, sample)[2].nominal_cost for sample in samples])
    np.testing.assert_allclose(u, samples[best, 0], rtol=1e-9)
    np.testing.assert_allclose(info.ess, 1, rtol=1e-9)


@pytest.mark.parametrize("count", [7, 8])
def test_antithetic_normals_are_mirrored_for_even_and_odd_counts(count):
    normals = path_integral.normals(KEY, (3, 2, count), antithetic=True)
    half = (count + 1) // 2
    assert normals.shape == (3, 2, count)
    np.testing.assert_array_equal(normals[..., half:], -normals[..., : count - half])
    assert len(np.unique(normals[..., :half])) == 6 * half


def test_an_odd_number_of_samples_gives_a_control_in_float32(light_dark):
    u, _, info = act(replace(SMALL, n_samples=7), light_dark)
    assert u.dtype == np.float32
    assert np.all(np.isfinite(u))
    assert 1 - 1e-6 <= info.ess <= 7 + 1e-6


def test_mirrored_samples_leave_a_symmetric_problem_alone(x64):
    """At rest at the goal, a sample and its mirror image cost the same."""
    problem = light_dark_problem(cost={"w_obs": 0}, prior_mean=[7, 0, 0, 0])
    u, plan, info = act(replace(SMALL, temperature=0.1), problem)
    np.testing.assert_allclose(u, 0, atol=1e-12)
    np.testing.assert_allclose(plan, 0, atol=1e-12)
    assert info.ess < 31  # though their weights are not the same


@pytest.mark.parametrize("count", [24, 23])
def test_blocks_of_samples_are_weighted_as_if_they_were_one(count, light_dark, x64, monkeypatch):
    """Against all samples of the same keys put together, with and without surplus samples in the
    last block.
    """
    monkeypatch.setattr(path_weights, "BLOCK", 10)
    controller = replace(SMALL, n_samples=count, sampler=mb.NominalSampler(control_std=1.0))
    problem = light_dark
    plan = jnp.full((6, 2), 0.3)
    u, _, info = quick_jit(controller.act)(
        problem, prior(problem), plan, KEY
    )  # not act_on: it knows another BLOCK
    increments = jnp.concatenate(
        [path_integral.normals(key, (6, 2, 8), False) for key in jax.random.split(KEY, 3)], -1
    )[..., :count]

    @quick_jit
    def all_at_once(problem: mb.Problem, increments: Array) -> tuple[Array, Array]:
        planned = controller.schedule.plan(problem, controller.path_cost, prior(problem), plan)
        costs, means = planned.costs(plan[:, :, None] + increments, None)
        costs += path_integral.girsanov(plan, increments, problem.cost.R * problem.dt)
        return means, path_weights.weights(costs, controller.temperature)

    means, w = all_at_once(problem, increments)
    np.testing.assert_allclose(info.means, means, rtol=1e-12)
    np.testing.assert_allclose(info.weights, w, rtol=1e-9)
    np.testing.assert_allclose(u, plan[0] + increments[0] @ w, rtol=1e-9)
    np.testing.assert_allclose(info.ess, 1 / np.sum(w**2), rtol=1e-9)


def test_innovation_samples_have_the_covariance_of_the_diffusion(light_dark, x64):
    @quick_jit
    def sample(problem: mb.Problem) -> tuple[Array, Array, Array]:
        nominal = jnp.zeros((3, 2))
        path_cost = mb.RiskSensitive()
        planned = mb.SharedCovariance().plan(problem, path_cost, prior(problem), nominal)
        draw = mb.InnovationSampler().prepare(problem, path_cost, planned, nominal, 1.0)
        increments, means, _ = draw(KEY, 5000)
        start = jnp.broadcast_to(planned.schedule.mean[0][:, None], means.shape[1:])
        before = jnp.concatenate([start[None], means[:-1]])
        undisturbed = jax.vmap(
            lambda mean: path_integral.rollouts(problem, mean, jnp.zeros((1, 2, 5000)))[0]
        )
        return increments, means - undisturbed(before), planned.schedule.diffusion

    increments, disturbance, diffusion = sample(light_dark)
    for k in range(3):
        assert_covariance(np.asarray(disturbance[k]).T, np.asarray(diffusion[k]) * 0.1)
        # the control that would do the same to the velocities
        np.testing.assert_allclose(increments[k] * 0.1, disturbance[k, 2:], atol=1e-12)


def test_the_same_key_gives_the_same_control_and_another_one_another(light_dark, x64):
    first, again, different = (act(SMALL, light_dark, key=jax.random.key(k))[0] for k in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.all(first != different)


@pytest.mark.parametrize(
    ("part", "field", "value"),
    [
        (mb.MPPI, "n_samples", 0),
        (mb.MPPI, "horizon", 0),
        (mb.MPPI, "temperature", 0),
        (mb.MPPI, "sampler", "laplace"),
        (mb.MPPI, "path_cost", "mean"),
        (mb.MPPI, "schedule", "riccati"),
        (mb.NominalSampler, "control_std", 0),
        (mb.NominalSampler, "alpha", 1.5),
        (mb.LaplaceSampler, "alpha", -0.5),
        (mb.RiskSensitive, "theta", -1),
        (mb.RiskSensitive, "variance_of", "none"),
        (mb.RiskSensitive, "expectation", "median"),
        (mb.RiskSensitive, "at_step_end", "middle"),
        (mb.CertaintyEquivalent, "at_step_end", "middle"),
        (mb.CertaintyEquivalent, "points_per_step", 0),
        (mb.SharedCovariance, "method", "none"),
        (mb.SharedCovariance, "components", "none"),
    ],
)
def test_settings_without_meaning_are_refused(part, field, value):
    with pytest.raises(ValueError, match=field):
        part(**{field: value})


@mb.struct
class OwnSchedule:
    """Runs the filter along every path, as a schedule of the user's own."""

    follows_controls: ClassVar[bool] = True

    def plan(self, problem, path_cost, belief, controls):
        return mb.PerPathCovariance().plan(problem, path_cost, belief, controls)


@pytest.mark.parametrize("schedule", [mb.PerPathCovariance(), OwnSchedule()])
def test_paths_that_no_control_leads_along_have_no_covariance_of_their_own(schedule):
    with pytest.raises(ValueError, match=f"{type(schedule).__name__} needs controls"):
        mb.MPPI(sampler=mb.InnovationSampler(), schedule=schedule)
