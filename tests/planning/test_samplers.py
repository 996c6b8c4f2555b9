"""Importance proposals: the same average of paths, from fewer of them."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import mppi_belief as mb
from helpers import light_dark_problem, quick_jit
from linear_system import lqr, random_problem
from mppi_belief.belief.prior import prior, prior_mixture
from mppi_belief.numerics.normals import standard_normal
from mppi_belief.planning import path_integral as pi
from mppi_belief.planning import samplers as proposals
from mppi_belief.planning.ilqr import charge_weights

STD, TEMPERATURE, HORIZON, N = 1.5, 2.0, 6, 4000
SETTINGS = {"temperature": TEMPERATURE, "control_std": STD}
PLANNER = mb.MPPIBelief(n_samples=N, horizon=HORIZON, theta=0.7, **SETTINGS)


@quick_jit
def act_on(
    problem: mb.Problem, controller: mb.MPPIBelief, plan: Array, keys: Array
) -> tuple[Array, Array]:
    """First controls (K, nu) and effective sample sizes (K,) for K keys."""

    def one(key: Array) -> tuple[Array, Array]:
        u, _, info = controller.act(problem, prior(problem), plan, key)
        return u, info.ess

    return jax.lax.map(one, keys)


def sampled(
    problem: mb.Problem, policies: tuple, aim: proposals.Reference, second: np.ndarray, key: Array
) -> tuple[Array, Array, Array]:
    """Normals and controls (H, nu, N) of two policies, and what their path costs are raised by (N,)."""

    @quick_jit
    def program(problem, policies, aim, key):
        eps = standard_normal(key, (HORIZON, 2, N))
        controls, _, density = proposals.rollouts(
            problem, jnp.asarray(problem.prior_mean), policies, second, eps
        )
        return eps, controls, proposals.correction(aim, TEMPERATURE, controls, density)

    return program(problem, policies, aim, key)


def near_an_obstacle() -> mb.Problem:
    return light_dark_problem(
        prior_mean=[2.2, 0.9, 1.0, -1.0], prior_std=[0.3, 0.3, 0.1, 0.1], cost={"w_obs": 30}
    )


@pytest.fixture
def plan(rng) -> np.ndarray:
    return rng.normal(size=(HORIZON, 2))


@pytest.mark.parametrize("control_std", [None, STD])
def test_of_a_linear_problem_with_quadratic_costs_all_paths_weigh_the_same(
    control_std, monkeypatch, x64, rng, plan
):
    monkeypatch.setattr(proposals, "about_nominal", lambda n, mirrored: np.zeros(n, bool))
    problem, keys = random_problem(rng, steps=HORIZON), jax.random.split(jax.random.key(0), 1)
    planner = mb.MPPIBelief(64, HORIZON, TEMPERATURE, control_std, proposal="laplace")
    np.testing.assert_allclose(act_on(problem, planner, plan, keys)[1], 64, rtol=1e-9)
    assert act_on(problem, replace(planner, proposal="nominal"), plan, keys)[1] < 0.8 * 64


def test_of_a_linear_problem_the_matched_policy_is_that_of_lqr(monkeypatch, x64, rng, plan):
    monkeypatch.setattr(proposals, "about_nominal", lambda n, mirrored: np.zeros(n, bool))
    problem = random_problem(rng, steps=HORIZON)
    planner = mb.MPPIBelief(2, HORIZON, TEMPERATURE, antithetic=True, proposal="laplace")
    (u,), _ = act_on(problem, planner, plan, jax.random.split(jax.random.key(0), 1))
    best = lqr(problem, np.asarray(problem.prior_mean), np.asarray(charge_weights(HORIZON, "end")))
    np.testing.assert_allclose(
        u, best[0], rtol=1e-8
    )  # a mirrored pair: the mean of the policy itself


def test_a_fifth_is_drawn_about_the_nominal_mirrored_pairs_together():
    assert [proposals.about_nominal(n, False).sum() for n in (1, 2, 5, 6, 20, 500)] == [
        1,
        1,
        1,
        2,
        4,
        100,
    ]
    assert not proposals.about_nominal(2, False)[1]
    for n in (2, 19, 20, 500):
        half, chosen = (n + 1) // 2, proposals.about_nominal(n, True)
        np.testing.assert_array_equal(chosen[half:], chosen[: n - half])
        assert chosen[:half].sum() == -(-half // 5)


def test_of_a_linear_problem_the_fifth_about_the_nominal_is_what_is_lost(x64, rng, plan):
    problem, keys = random_problem(rng, steps=HORIZON), jax.random.split(jax.random.key(0), 1)
    planner = mb.MPPIBelief(400, HORIZON, TEMPERATURE, 4 * STD, proposal="laplace")
    (ess,) = act_on(problem, planner, plan, keys)[1]
    assert 0.8 * 400 - 5 < ess <= 400


def test_an_expansion_that_leads_far_astray_costs_no_more_than_its_samples(monkeypatch, x64, plan):
    """A policy in whose samples nothing is right: the others decide, as if there were only they."""

    def astray(cost, problem, means, aim, temperature, fallback):
        return fallback._replace(controls=fallback.controls + 50.0)

    monkeypatch.setattr(proposals, "laplace", astray)
    problem, keys = near_an_obstacle(), jax.random.split(jax.random.key(4), 60)
    many = (
        N - 10
    )  # another number than in other tests, for which a program without this patch is kept
    guided = act_on(problem, replace(PLANNER, n_samples=many, proposal="laplace"), plan, keys)
    own = act_on(
        problem,
        replace(PLANNER, n_samples=int(proposals.about_nominal(many, False).sum())),
        plan,
        keys,
    )
    np.testing.assert_allclose(guided[1].mean(), own[1].mean(), rtol=0.05)
    error = np.hypot(guided[0].std(axis=0), own[0].std(axis=0)) / np.sqrt(len(keys))
    assert np.all(np.abs(guided[0].mean(axis=0) - own[0].mean(axis=0)) < 4 * error)


OPTIONS = [
    {},
    {"evaluate": "mean", "alpha": 0.3},
    {"charge": "start", "risk": "total", "antithetic": True},
]


@pytest.mark.parametrize("options", OPTIONS)
def test_the_limit_of_many_samples_is_that_about_the_nominal_and_is_reached_with_fewer(
    options, x64, plan
):
    problem, keys = near_an_obstacle(), jax.random.split(jax.random.key(1), 60)
    planner = replace(PLANNER, **options)
    plain, guided = (
        act_on(problem, replace(planner, proposal=p), plan, keys) for p in ("nominal", "laplace")
    )
    errors = [u.std(axis=0) / np.sqrt(len(keys)) for u, _ in (plain, guided)]
    gap = np.abs(plain[0].mean(axis=0) - guided[0].mean(axis=0))
    assert np.all(gap < 4 * np.hypot(*errors)), (gap, errors)
    assert np.all(errors[1] < 0.8 * errors[0])
    assert guided[1].mean() > 2 * plain[1].mean()


@pytest.mark.parametrize(("std", "alpha"), [(None, None), (STD, None), (STD, 0.3), (None, 0.3)])
def test_about_the_nominal_with_its_own_covariance_it_is_the_term_of_the_nominal(
    std, alpha, x64, plan
):
    problem = near_an_obstacle()
    aim = proposals.reference(problem, jnp.asarray(plan), TEMPERATURE, std, alpha)
    policy = proposals.plain(problem, jnp.asarray(plan), TEMPERATURE, std)
    second = proposals.about_nominal(N, False)
    eps, controls, correction = sampled(problem, (policy, policy), aim, second, jax.random.key(2))
    increments = pi.matched_increments(problem, eps, TEMPERATURE, std)
    np.testing.assert_allclose(controls - plan[:, :, None], increments, atol=1e-12)
    weight = pi.girsanov_weight(problem, TEMPERATURE, std, alpha)
    apart = correction - pi.girsanov(jnp.asarray(plan), increments, weight)
    np.testing.assert_allclose(apart, apart[0], rtol=1e-9, atol=1e-9)


def test_a_weight_above_the_exact_one_does_not_push_away_from_the_nominal(x64, plan):
    problem = light_dark_problem(
        cost={"control_weight": [1.0, 100.0]}
    )  # R dt std^2 / lambda: 0.1125 and 11.25
    aim = proposals.reference(problem, jnp.asarray(plan), TEMPERATURE, STD, None)
    np.testing.assert_allclose(aim.centre, plan * [1 - 0.1125, 0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("second", [np.zeros(N, bool), np.arange(N) % 4 == 0])
def test_the_ratio_of_densities_of_policies_with_feedback_has_mean_one(second, x64, rng, plan):
    """With the constants that the weights leave out; the ratio's mean is one for any policies."""
    problem = near_an_obstacle()
    aim = proposals.Reference(0.3 * jnp.asarray(plan), TEMPERATURE / STD**2 * jnp.eye(2))
    factors = STD * (0.9 * np.eye(2) + 0.05 * np.tril(rng.normal(size=(HORIZON, 2, 2))))
    policy = proposals.Proposal(
        rng.normal(size=(HORIZON, 4)), 0.2 * plan, 0.02 * rng.normal(size=(HORIZON, 2, 4)), factors
    )
    wide = policy._replace(controls=-plan, factors=1.2 * factors)
    keys = jax.random.split(jax.random.key(3), 10)
    found = [sampled(problem, (policy, wide), aim, second, key)[2] for key in keys]
    ratios = np.exp(-np.asarray(found) / TEMPERATURE) / STD ** (2 * HORIZON)
    mean, error = np.mean(ratios), np.std(ratios) / np.sqrt(np.size(ratios))
    assert abs(mean - 1) < 4 * error < 0.1


@pytest.fixture
def expanded(plan) -> Callable[..., tuple[proposals.Proposal, proposals.Proposal]]:
    """The Laplace policy for a cost of (x, k) about means that move on by one at each step, and the nominal's."""

    def make(
        cost: Callable[[Array, Array], Array],
    ) -> tuple[proposals.Proposal, proposals.Proposal]:
        problem = near_an_obstacle()
        aim = proposals.reference(problem, jnp.asarray(plan), TEMPERATURE, STD, None)
        means = jnp.ones((HORIZON + 1, 4)) * jnp.arange(HORIZON + 1)[:, None]
        fallback = proposals.plain(problem, jnp.asarray(plan), TEMPERATURE, STD)
        return proposals.laplace(cost, problem, means, aim, TEMPERATURE, fallback), fallback

    return make


def test_an_expansion_that_is_not_finite_leaves_the_nominal(expanded):
    policy, fallback = expanded(lambda x, k: 2.5e37 * jnp.sum(x**2))
    for found, given in zip(policy, fallback, strict=True):
        np.testing.assert_array_equal(found, given)


def test_a_state_without_finite_derivatives_counts_as_if_it_cost_nothing(x64, expanded):
    singular, _ = expanded(lambda x, k: jnp.sum(x**2) + 1e-9 * jnp.sqrt(jnp.sum((x - 3) ** 2)))
    without, _ = expanded(lambda x, k: jnp.sum(x**2) * (k != 3))
    assert np.any(without.gains)
    for found, expected in zip(singular, without, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


def test_it_plans_from_one_gaussian_through_the_control_and_says_so():
    problem = light_dark_problem(prior_modes=np.array([[0, 1, 0, 0], [0, -1, 0, 0]]))
    planner = replace(PLANNER, proposal="laplace", n_samples=8)

    def plans(planner: mb.MPPIBelief, belief: Any) -> tuple[int, ...]:
        traced = jax.eval_shape(
            planner.act, problem, belief, planner.init(problem), jax.random.key(0)
        )
        return traced[0].shape

    with pytest.raises(ValueError, match=r"proposal=laplace .* diffusion=matched"):
        plans(replace(planner, diffusion="innovation"), prior(problem))
    with pytest.raises(ValueError, match=r"proposal=laplace .* plan_from=moments"):
        plans(planner, prior_mixture(problem))
    assert plans(replace(planner, plan_from="moments"), prior_mixture(problem)) == (2,)
