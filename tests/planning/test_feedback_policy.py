"""Importance proposals: the same average of paths, from fewer of them."""

from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import mppi_belief as mb
from helpers import assert_mean, light_dark_problem, quick_jit
from linear_system import lqr, random_problem
from mppi_belief.belief.prior import prior, prior_mixture
from mppi_belief.numerics.normals import standard_normal
from mppi_belief.planning import feedback_policy, policy_mixture
from mppi_belief.planning import path_integral as pi
from mppi_belief.planning.lq_problem import charge_weights

STD = 1.5
TEMPERATURE = 2.0
HORIZON = 6
N = 4000
PLANNER = mb.MPPI(N, HORIZON, TEMPERATURE, mb.RiskSensitive(0.7), mb.NominalSampler(STD))
GUIDED = replace(PLANNER, sampler=mb.LaplaceSampler(STD))


@quick_jit
def act_on(
    problem: mb.Problem, controller: mb.MPPI, plan: Array, keys: Array
) -> tuple[Array, Array]:
    """First controls (K, nu) and effective sample sizes (K,) for K keys."""

    def sample_one(key: Array) -> tuple[Array, Array]:
        u, _, info = controller.act(problem, prior(problem), plan, key)
        return u, info.ess

    return jax.lax.map(sample_one, keys)


def sampled(
    problem: mb.Problem,
    policies: tuple,
    reference: feedback_policy.ReferenceDensity,
    second: np.ndarray,
    key: Array,
) -> tuple[Array, Array, Array]:
    """Normals and controls (H, nu, N) of two policies, and what their path costs are raised by
    (N,).
    """

    @quick_jit
    def program(problem, policies, reference, key):
        eps = standard_normal(key, (HORIZON, 2, N))
        controls, _, log_density = policy_mixture.feedback_rollouts(
            problem, jnp.asarray(problem.prior_mean), policies, second, eps
        )
        return (
            eps,
            controls,
            policy_mixture.density_correction(reference, TEMPERATURE, controls, log_density),
        )

    return program(problem, policies, reference, key)


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
    monkeypatch.setattr(policy_mixture, "about_nominal", lambda n, mirrored: np.zeros(n, bool))
    problem = random_problem(rng, steps=HORIZON)
    keys = jax.random.split(jax.random.key(0), 1)
    planner = mb.MPPI(64, HORIZON, TEMPERATURE, sampler=mb.LaplaceSampler(control_std))
    plain = replace(planner, sampler=mb.NominalSampler(control_std))
    np.testing.assert_allclose(act_on(problem, planner, plan, keys)[1], 64, rtol=1e-9)
    assert act_on(problem, plain, plan, keys)[1] < 0.8 * 64


def test_of_a_linear_problem_a_single_mirrored_pair_gives_the_control_of_lqr(x64, rng, plan):
    problem = random_problem(rng, steps=HORIZON)
    planner = mb.MPPI(2, HORIZON, TEMPERATURE, sampler=mb.LaplaceSampler(antithetic=True))
    (u,), _ = act_on(problem, planner, plan, jax.random.split(jax.random.key(0), 1))
    best = lqr(problem, np.asarray(problem.prior_mean), np.asarray(charge_weights(HORIZON, True)))
    np.testing.assert_allclose(u, best[0], rtol=1e-8)  # the mean of the policy itself


def test_a_single_sample_is_drawn_from_the_laplace_policy(x64, rng, plan):
    problem = random_problem(rng, steps=HORIZON)
    best = lqr(problem, np.asarray(problem.prior_mean), np.asarray(charge_weights(HORIZON, True)))
    keys = jax.random.split(jax.random.key(0), 400)
    planner = mb.MPPI(1, HORIZON, TEMPERATURE, sampler=mb.LaplaceSampler())
    controls, ess = act_on(problem, planner, plan, keys)
    assert_mean(np.asarray(controls), best[0])
    np.testing.assert_array_equal(ess, 1)


def test_a_fifth_is_drawn_about_the_nominal_mirrored_pairs_together():
    assert [policy_mixture.about_nominal(n, False).sum() for n in (1, 2, 5, 6, 20, 500)] == [
        0,
        1,
        1,
        2,
        4,
        100,
    ]
    assert not policy_mixture.about_nominal(2, False)[1]
    assert not policy_mixture.about_nominal(2, True).any()
    for n in (19, 20, 500):
        half = (n + 1) // 2
        chosen = policy_mixture.about_nominal(n, True)
        np.testing.assert_array_equal(chosen[half:], chosen[: n - half])
        assert chosen[:half].sum() == -(-half // 5)


def test_of_a_linear_problem_the_fifth_about_the_nominal_is_what_is_lost(x64, rng, plan):
    problem = random_problem(rng, steps=HORIZON)
    keys = jax.random.split(jax.random.key(0), 1)
    planner = mb.MPPI(400, HORIZON, TEMPERATURE, sampler=mb.LaplaceSampler(4 * STD))
    (ess,) = act_on(problem, planner, plan, keys)[1]
    assert 0.8 * 400 - 5 < ess <= 400


def test_an_expansion_that_leads_far_astray_costs_no_more_than_its_samples(monkeypatch, x64, plan):
    """A policy in whose samples nothing is right: the others decide, as if there were only they."""

    def astray(cost, problem, means, reference, temperature, fallback):
        return fallback._replace(controls=fallback.controls + 50.0)

    monkeypatch.setattr(feedback_policy, "laplace_policy", astray)
    problem = near_an_obstacle()
    keys = jax.random.split(jax.random.key(4), 60)
    many = (
        N - 10
    )  # another number than in other tests, for which a program without this patch is kept
    guided = act_on(problem, replace(GUIDED, n_samples=many), plan, keys)
    own = act_on(
        problem,
        replace(PLANNER, n_samples=int(policy_mixture.about_nominal(many, False).sum())),
        plan,
        keys,
    )
    np.testing.assert_allclose(guided[1].mean(), own[1].mean(), rtol=0.05)
    error = np.hypot(guided[0].std(axis=0), own[0].std(axis=0)) / np.sqrt(len(keys))
    assert np.all(np.abs(guided[0].mean(axis=0) - own[0].mean(axis=0)) < 4 * error)


OPTIONS = [
    (mb.RiskSensitive(0.7), {}),
    (mb.CertaintyEquivalent(), {"alpha": 0.3}),
    (mb.RiskSensitive(0.7, "total", at_step_end=False), {"antithetic": True}),
]


@pytest.mark.parametrize(("path_cost", "options"), OPTIONS)
def test_the_limit_of_many_samples_is_that_about_the_nominal_and_is_reached_with_fewer(
    path_cost, options, x64, plan
):
    problem = near_an_obstacle()
    keys = jax.random.split(jax.random.key(1), 60)
    plain, guided = (
        act_on(
            problem,
            replace(PLANNER, path_cost=path_cost, sampler=sampler(STD, **options)),
            plan,
            keys,
        )
        for sampler in (mb.NominalSampler, mb.LaplaceSampler)
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
    reference = feedback_policy.reference_density(
        problem, jnp.asarray(plan), TEMPERATURE, std, alpha
    )
    policy = feedback_policy.nominal_policy(problem, jnp.asarray(plan), TEMPERATURE, std)
    second = policy_mixture.about_nominal(N, False)
    eps, controls, correction = sampled(
        problem, (policy, policy), reference, second, jax.random.key(2)
    )
    increments = pi.matched_increments(problem, eps, TEMPERATURE, std)
    np.testing.assert_allclose(controls - plan[:, :, None], increments, atol=1e-12)
    weight = pi.girsanov_weight(problem, TEMPERATURE, std, alpha)
    apart = correction - pi.girsanov(jnp.asarray(plan), increments, weight)
    np.testing.assert_allclose(apart, apart[0], rtol=1e-9, atol=1e-9)


def test_a_weight_above_the_exact_one_does_not_push_away_from_the_nominal(x64, plan):
    problem = light_dark_problem(
        cost={"control_weight": [1.0, 100.0]}
    )  # R dt std^2 / lambda: 0.1125 and 11.25
    reference = feedback_policy.reference_density(
        problem, jnp.asarray(plan), TEMPERATURE, STD, None
    )
    np.testing.assert_allclose(reference.centre, plan * [1 - 0.1125, 0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("second", [np.zeros(N, bool), np.arange(N) % 4 == 0])
def test_the_ratio_of_densities_of_policies_with_feedback_has_mean_one(second, x64, rng, plan):
    """With the constants that the weights leave out; the ratio's mean is one for any policies."""
    problem = near_an_obstacle()
    reference = feedback_policy.ReferenceDensity(
        0.3 * jnp.asarray(plan), TEMPERATURE / STD**2 * jnp.eye(2)
    )
    factors = STD * (0.9 * np.eye(2) + 0.05 * np.tril(rng.normal(size=(HORIZON, 2, 2))))
    policy = feedback_policy.FeedbackPolicy(
        rng.normal(size=(HORIZON, 4)), 0.2 * plan, 0.02 * rng.normal(size=(HORIZON, 2, 4)), factors
    )
    wide = policy._replace(controls=-plan, factors=1.2 * factors)
    keys = jax.random.split(jax.random.key(3), 10)
    computed = [sampled(problem, (policy, wide), reference, second, key)[2] for key in keys]
    ratios = np.exp(-np.asarray(computed) / TEMPERATURE) / STD ** (2 * HORIZON)
    mean = np.mean(ratios)
    error = np.std(ratios) / np.sqrt(np.size(ratios))
    assert abs(mean - 1) < 4 * error < 0.1


@pytest.fixture
def expanded(
    plan,
) -> Callable[..., tuple[feedback_policy.FeedbackPolicy, feedback_policy.FeedbackPolicy]]:
    """The Laplace policy for a cost of (x, k) about means that move on by one at each step, and the
    nominal's.
    """

    def make(
        cost: Callable[[Array, Array], Array],
    ) -> tuple[feedback_policy.FeedbackPolicy, feedback_policy.FeedbackPolicy]:
        problem = near_an_obstacle()
        reference = feedback_policy.reference_density(
            problem, jnp.asarray(plan), TEMPERATURE, STD, None
        )
        means = jnp.ones((HORIZON + 1, 4)) * jnp.arange(HORIZON + 1)[:, None]
        fallback = feedback_policy.nominal_policy(problem, jnp.asarray(plan), TEMPERATURE, STD)
        return feedback_policy.laplace_policy(
            cost, problem, means, reference, TEMPERATURE, fallback
        ), fallback

    return make


def test_an_expansion_that_is_not_finite_leaves_the_nominal(expanded):
    policy, fallback = expanded(lambda x, k: 2.5e37 * jnp.sum(x**2))
    for computed, given in zip(policy, fallback, strict=True):
        np.testing.assert_array_equal(computed, given)


def test_a_state_without_finite_derivatives_counts_as_if_it_cost_nothing(x64, expanded):
    singular, _ = expanded(lambda x, k: jnp.sum(x**2) + 1e-9 * jnp.sqrt(jnp.sum((x - 3) ** 2)))
    without, _ = expanded(lambda x, k: jnp.sum(x**2) * (k != 3))
    assert np.any(without.gains)
    for computed, expected in zip(singular, without, strict=True):
        np.testing.assert_allclose(computed, expected, rtol=1e-6, atol=1e-6)


MODES = [[0.0, 0.3, 0.0, 0.0], [0.0, -0.6, 0.0, 0.0]]
ELSEWHERE = {
    "a mixture, by component": (prior_mixture, mb.SharedCovariance()),
    "a mixture, by its moments": (prior_mixture, mb.SharedCovariance(components=False)),
    "a covariance per path": (prior, mb.PerPathCovariance()),
}


@pytest.mark.parametrize("case", ELSEWHERE)
def test_the_limit_is_the_same_with_every_schedule(case, x64, plan):
    """The policy is that of one Gaussian with a shared covariance; costs and weights are the
    planner's own.
    """
    problem = replace(near_an_obstacle(), prior_modes=np.array(MODES))
    keys = jax.random.split(jax.random.key(5), 40)
    belief, schedule = ELSEWHERE[case]

    @quick_jit
    def controls(planner: mb.MPPI) -> tuple[Array, Array]:
        def sample_one(key: Array) -> tuple[Array, Array]:
            u, _, info = planner.act(problem, belief(problem), jnp.asarray(plan), key)
            return u, info.ess

        return jax.lax.map(sample_one, keys)

    plain, guided = (controls(replace(p, schedule=schedule)) for p in (PLANNER, GUIDED))
    errors = [u.std(axis=0) / np.sqrt(len(keys)) for u, _ in (plain, guided)]
    gap = np.abs(plain[0].mean(axis=0) - guided[0].mean(axis=0))
    assert np.all(gap < 4 * np.hypot(*errors)), (gap, errors)
    assert guided[1].mean() > plain[1].mean()
