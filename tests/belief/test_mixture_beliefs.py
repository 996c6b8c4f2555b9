"""A belief with several modes: prior, bank of filters, moments, costs, and planning."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array
from scipy import stats

import mppi_belief as mb
import reference
from cli_helpers import compose
from helpers import assert_covariance, assert_mean, light_dark_problem, quick_jit, random_spd
from linear_system import random_problem
from mppi_belief.belief import cost as belief_cost
from mppi_belief.belief.gaussian import MixtureBelief, RootBelief
from mppi_belief.belief.kalman import correct
from mppi_belief.belief.moment_rules import MomentRules
from mppi_belief.belief.prior import prior, prior_mixture, sample_prior
from mppi_belief.belief.schedule import GainSchedule
from mppi_belief.errors import ConfigError
from mppi_belief.filters.mixture import reweighted
from mppi_belief.numerics.square_root import log_normal_density
from mppi_belief.planning.parts import PlanInfo
from mppi_belief.planning.schedules.shared import MixturePlan
from mppi_belief.trial import check

KEY = jax.random.key(4)
MODES = np.array([[0.3, 1.5, 0, 0], [0.0, -1.0, 0.2, 0]])
WEIGHTS = np.array([0.7, 0.3])
THETA = 0.7
SMALL = mb.MPPI(16, 5, 30.0, mb.RiskSensitive(THETA), mb.NominalSampler(control_std=1.0))
mixture_moments = quick_jit(belief_cost.mixture_moments)
mixture_terminal = quick_jit(belief_cost.mixture_terminal)
mixture_risk_sensitive = quick_jit(
    belief_cost.mixture_risk_sensitive, static_argnames=("variance_of", "rules")
)
risk_sensitive = quick_jit(belief_cost.risk_sensitive, static_argnames=("variance_of", "rules"))


@quick_jit
def act(
    problem: mb.Problem, controller: mb.MPPI, belief: Any, plan: Array
) -> tuple[Array, Array, PlanInfo]:
    return controller.act(problem, belief, plan, KEY)


@quick_jit
def update(problem: mb.Problem, filter: mb.Filter, belief: Any, u: Array, y: Array) -> Any:
    return filter.update(problem, belief, u, y, KEY)


def two_places() -> mb.Problem:
    """The reference scenario with a start in one of two places."""
    return light_dark_problem(prior_modes=MODES, prior_weights=10 * WEIGHTS)


def mixture(rng: np.random.Generator) -> MixtureBelief:
    """Components around the upper obstacle, each with a covariance of its own."""
    covs = [random_spd(rng, 4, 0.02, 0.3) for _ in WEIGHTS]
    means = np.array([2.5, 0.6, 0.3, -0.2]) + 0.5 * rng.normal(size=(2, 4))
    return MixtureBelief(*map(jnp.asarray, (means, np.linalg.cholesky(covs), np.log(WEIGHTS))))


def covs_of(belief: MixtureBelief) -> Array:
    return belief.roots @ jnp.swapaxes(belief.roots, 1, 2)


def charged(problem: mb.Problem, means: Any, covs: Any) -> Array:
    """q_RS of the mixture at one instant."""
    components = (WEIGHTS, jnp.stack(means), jnp.stack(covs))
    return mixture_risk_sensitive(problem, *components, THETA)


def test_moments_are_those_of_the_whole(x64, rng):
    belief = mixture(rng)
    second = sum(
        w * (S + np.outer(m, m))
        for w, m, S in zip(WEIGHTS, belief.means, covs_of(belief), strict=True)
    )
    mean = WEIGHTS @ np.asarray(belief.means)
    np.testing.assert_allclose(belief.mean, mean, rtol=1e-12)
    np.testing.assert_allclose(belief.cov, second - np.outer(mean, mean), rtol=1e-10)
    np.testing.assert_allclose(belief.root @ belief.root.T, belief.cov, rtol=1e-10)


def test_a_start_is_drawn_from_one_of_the_modes_as_often_as_its_weight_says(x64):
    problem = two_places()
    states = np.asarray(
        quick_jit(jax.vmap(lambda key: sample_prior(problem, key)))(jax.random.split(KEY, 20_000))
    )
    mean, cov = prior(problem)
    np.testing.assert_allclose(mean, problem.prior_mean + WEIGHTS @ MODES, rtol=1e-12)
    assert_mean(states, mean)
    offsets = (states - problem.prior_mean)[:, None] - MODES
    nearest = np.argmin(np.sum(offsets[..., :2] ** 2, axis=-1), axis=1)
    assert_mean(nearest[:, None] == np.arange(2), WEIGHTS)
    for mode in range(2):
        assert_covariance(offsets[nearest == mode, mode], np.diag(problem.prior_std**2))
    # the one Gaussian that stands for both of them
    assert_mean(np.einsum("ni,nj->nij", states - mean, states - mean), cov)


def test_every_filter_starts_at_the_moments_of_the_modes(x64):
    problem = two_places()
    exact = prior(problem)
    for filter in (mb.EKF(), mb.UKF(), mb.MixtureFilter()):
        belief = filter.init(problem, KEY)
        np.testing.assert_allclose(belief.mean, exact.mean, rtol=1e-12)
        np.testing.assert_allclose(belief.cov, exact.cov, atol=1e-12)
    start = quick_jit(jax.vmap(lambda key: mb.ParticleFilter(200).init(problem, key).mean))
    assert_mean(start(jax.random.split(KEY, 50)), exact.mean)


def test_one_mode_is_one_gaussian(scalar, x64):
    usual = scalar.problem()
    single = replace(usual, prior_modes=np.zeros((1, 1)))
    np.testing.assert_array_equal(sample_prior(usual, KEY), sample_prior(single, KEY))
    u = jnp.array([1.0])
    y = jnp.array([1.3])
    exact, computed = (
        update(problem, filter, filter.init(problem, KEY), u, y)
        for filter, problem in ((mb.EKF(), usual), (mb.MixtureFilter(), single))
    )
    np.testing.assert_allclose(computed.mean, exact.mean, rtol=1e-12)
    np.testing.assert_allclose(computed.cov, exact.cov, rtol=1e-12)


def test_the_bank_is_bayes_rule_on_a_linear_system(x64, rng):
    """Compares with all measurements at once: one Gaussian vector per mode, no recursion."""
    modes = rng.normal(size=(2, 3))
    steps = 4
    problem = replace(
        random_problem(rng), prior_modes=modes, prior_weights=WEIGHTS, prior_std=np.full(3, 0.4)
    )
    system = problem.system
    dt = problem.dt
    F = np.eye(3) + dt * system.A
    C = np.asarray(system.C)
    Q = dt * system.channel @ system.channel.T
    controls = rng.normal(size=(steps, 2))
    ys = rng.normal(size=(steps, 1))
    belief = mb.MixtureFilter().init(problem, KEY)
    for u, y in zip(controls, ys, strict=True):
        belief = update(problem, mb.MixtureFilter(), belief, u, y)

    # x_1..x_n in terms of x_0 and the noises of every step
    powers = [np.linalg.matrix_power(F, k) for k in range(steps + 1)]
    none = np.zeros((3, 3))
    lift = np.block(
        [[powers[k - j] if j <= k else none for j in range(steps + 1)] for k in range(1, steps + 1)]
    )
    noises = np.kron(np.eye(steps + 1), Q)
    noises[:3, :3] = np.diag(problem.prior_std**2)
    states = lift @ noises @ lift.T
    H = np.kron(np.eye(steps), C)
    S = H @ states @ H.T + 0.09 * np.eye(steps)
    gain = states @ H.T @ np.linalg.inv(S)
    logs = []
    for i, mode in enumerate(modes):
        trajectory = [problem.prior_mean + mode]
        for u in controls:
            trajectory.append(F @ trajectory[-1] + dt * np.asarray(system.B) @ u)
        expected = np.concatenate(trajectory[1:])
        logs.append(
            np.log(WEIGHTS[i]) + stats.multivariate_normal(H @ expected, S).logpdf(ys[:, 0])
        )
        np.testing.assert_allclose(
            belief.means[i], (expected + gain @ (ys[:, 0] - H @ expected))[-3:], rtol=1e-9
        )
        np.testing.assert_allclose(
            covs_of(belief)[i], (states - gain @ H @ states)[-3:, -3:], atol=1e-10
        )
    np.testing.assert_allclose(
        belief.log_weights, np.asarray(logs) - np.logaddexp.reduce(logs), rtol=1e-9
    )


def test_how_much_measurements_scatter_tells_modes_apart(light_dark, x64):
    """log det S counts: compares modes equally far from a measurement, in dark and light."""
    certain = jnp.zeros((4, 4))
    for p_x, sigma in ((3.0, 2 / np.sqrt(2) + 0.1), (5.0, 0.1)):
        predicted = RootBelief(jnp.array([p_x, 1, 0, 0]), certain)
        _, innovation, innovation_cov = correct(light_dark, predicted, jnp.array([4.0, 1.0]))
        computed = log_normal_density(innovation, innovation_cov)
        expected = stats.norm(scale=sigma).logpdf([1.0, 0.0]).sum() + np.log(2 * np.pi)
        np.testing.assert_allclose(computed, expected, rtol=1e-9)


def test_weights_stay_as_they_were_where_a_measurement_is_beyond_all():
    before = jnp.log(jnp.array([0.25, 0.75]))
    np.testing.assert_allclose(
        reweighted(before, jnp.array([-jnp.inf, -jnp.inf])), before, rtol=1e-6
    )
    np.testing.assert_allclose(reweighted(before, jnp.array([-jnp.inf, -1e30])), [-jnp.inf, 0])
    np.testing.assert_allclose(reweighted(before, jnp.array([-1e8, jnp.nan])), [0, -jnp.inf])


def test_expectation_variance_and_covariance_agree_with_monte_carlo(light_dark, x64, rng):
    belief = mixture(rng)
    cost = light_dark.cost
    n = 100_000
    chosen = rng.choice(2, size=n, p=WEIGHTS)
    x = np.asarray(belief.means)[chosen]
    x = x + np.einsum("nij,nj->ni", np.asarray(belief.roots)[chosen], rng.normal(size=(n, 4)))
    base, penalty = (np.asarray(quick_jit(jax.vmap(f))(x)) for f in (cost.base, light_dark.penalty))
    computed = mixture_moments(light_dark, belief.weights, belief.means, covs_of(belief))
    assert_mean(base, computed.base)
    assert_mean(penalty, computed.penalty)
    assert_mean((base - computed.base) ** 2, computed.base_var)
    assert_mean((penalty - computed.penalty) ** 2, computed.penalty_var)
    assert_mean((base - computed.base) * (penalty - computed.penalty), computed.covariance)
    terminal = mixture_terminal(light_dark, belief.weights, belief.means, covs_of(belief))
    assert_mean(np.asarray(quick_jit(jax.vmap(cost.terminal))(x)), terminal)


@pytest.mark.parametrize(
    ("variance_of", "rules"),
    [
        ("penalty", MomentRules()),
        ("total", MomentRules("at_mean")),
        ("total", MomentRules("exact", "sigma_points")),
        ("penalty", MomentRules("delta", "delta")),
        ("penalty", MomentRules("at_mean", "at_mean")),
    ],
)
def test_equal_components_cost_what_one_does(variance_of, rules, light_dark, x64, rng):
    belief = mixture(rng)
    mean = belief.means[0]
    cov = covs_of(belief)[0]
    twice = (WEIGHTS, jnp.stack([mean] * 2), jnp.stack([cov] * 2), 0.7)
    expected = risk_sensitive(light_dark, mean, cov, 0.7, variance_of=variance_of, rules=rules)
    computed = mixture_risk_sensitive(light_dark, *twice, variance_of=variance_of, rules=rules)
    np.testing.assert_allclose(computed, expected, rtol=1e-12)


def test_variance_has_its_digits_in_single_precision_at_large_weights():
    """E[q^2] - E[q]^2 of penalties of 1e4 that hardly differ would leave no digit."""
    problem = light_dark_problem(cost={"w_obs": 1e4})
    means = (np.array([3, 1, 0, 0]) + np.array([[1e-3, 0, 0, 0], [0, 2e-3, 0, 0]])).astype(
        np.float32
    )
    covs = np.stack([np.diag([1e-6, 1e-6, 0.1, 0.1])] * 2).astype(np.float32)
    computed = mixture_moments(problem, jnp.asarray(WEIGHTS, jnp.float32), means, covs)
    centers = np.array([[3.0, 1.0], [3.0, -1.0]])
    each = [
        reference.bump_moments(m.astype(float), S.astype(float), centers, 0.285)
        for m, S in zip(means, covs, strict=True)
    ]
    first = sum(w * e for w, (e, _) in zip(WEIGHTS, each, strict=True))
    second = sum(w * (v + e**2) for w, (e, v) in zip(WEIGHTS, each, strict=True))
    np.testing.assert_allclose(computed.penalty, 1e4 * first, rtol=1e-5)
    np.testing.assert_allclose(computed.penalty_var, 1e8 * (second - first**2), rtol=0.02)


def test_a_gap_that_both_modes_fit_through_is_blocked_for_one_gaussian(x64):
    """An obstacle between two lanes is in neither's way, and in the way of the mean of both."""
    problem = light_dark_problem(obstacles=mb.Obstacles([[3, 0]], 0.65))
    root = jnp.diag(jnp.array([0.2, 0.2, 0.1, 0.1]))
    belief = MixtureBelief(
        jnp.array([[3, 1.6, 0, 0], [3, -1.6, 0, 0]]),
        jnp.stack([root] * 2),
        jnp.log(jnp.full(2, 0.5)),
    )
    each = mixture_moments(problem, belief.weights, belief.means, covs_of(belief))
    merged = mixture_moments(
        problem, belief.weights, jnp.stack([belief.mean] * 2), jnp.stack([belief.cov] * 2)
    )
    assert each.penalty < 1e-3 * merged.penalty
    assert each.penalty_var < 1e-3 * merged.penalty_var


def test_a_mixture_of_one_gives_the_control_of_one_gaussian(x64, rng):
    problem = two_places()
    plan = jnp.asarray(rng.normal(size=(5, 2)))
    mean = prior_mixture(problem).means[0]
    root = jnp.diag(jnp.asarray(problem.prior_std))
    expected = act(problem, SMALL, mb.Belief(mean, root**2), plan)
    computed = act(problem, SMALL, MixtureBelief(mean[None], root[None], jnp.zeros(1)), plan)
    for a, b in zip(jax.tree.leaves(computed), jax.tree.leaves(expected), strict=True):
        assert a.shape == b.shape
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)
    # and so does one that is the same twice, however it is weighted
    twice = MixtureBelief(
        jnp.stack([mean] * 2), jnp.stack([root] * 2), jnp.log(jnp.asarray(WEIGHTS))
    )
    again = act(problem, SMALL, twice, plan)
    np.testing.assert_allclose(again[0], expected[0], rtol=1e-9)
    np.testing.assert_allclose(again[2].nominal_cost, expected[2].nominal_cost, rtol=1e-9)


def test_a_planner_can_be_shown_the_moments_alone(scalar, x64):
    problem = replace(scalar.problem(), prior_modes=[[1.0], [-2.0]], prior_weights=WEIGHTS)
    belief = prior_mixture(problem)
    plan = jnp.full((5, 1), 0.3)
    controller = replace(SMALL, path_cost=mb.RiskSensitive(THETA, "total"))
    expected = act(problem, controller, mb.Belief(belief.mean, belief.cov), plan)
    computed = act(
        problem, replace(controller, schedule=mb.SharedCovariance(components=False)), belief, plan
    )
    np.testing.assert_allclose(computed[0], expected[0], rtol=1e-9)
    assert (
        abs(act(problem, controller, belief, plan)[2].nominal_cost / expected[2].nominal_cost - 1)
        > 0.01
    )


def test_every_component_follows_the_same_controls_with_its_own_schedule(x64, rng):
    """Step by step, the covariances by the filter's recursion in plain form."""
    problem = two_places()
    plan = rng.normal(size=(5, 2))
    model = reference.light_dark(sampled=True, dt=0.1)
    _, _, info = act(problem, SMALL, prior_mixture(problem), jnp.asarray(plan))
    means = [problem.prior_mean + mode for mode in MODES]
    covs = [np.diag(problem.prior_std**2)] * 2
    total = 0.0
    for u in plan:
        for i in range(2):
            y = (means[i] + 0.1 * (model.A @ means[i] + model.B @ u))[
                :2
            ]  # as foretold, so that the mean stays
            means[i], covs[i] = reference.kalman_step(
                means[i],
                covs[i],
                y,
                lambda x, u=u: x + 0.1 * (model.A @ x + model.B @ u),
                lambda x: model.C @ x,
                model.Q * 0.1,
                lambda x: model.intensity(x) / 0.1,
            )
        total += 0.1 * charged(problem, means, covs)
    terminal = mixture_terminal(problem, WEIGHTS, jnp.stack(means), jnp.stack(covs))
    np.testing.assert_allclose(info.nominal_cost, total + terminal, rtol=1e-7)
    mean = WEIGHTS @ np.stack(means)
    spread = sum(
        w * (S + np.outer(m - mean, m - mean)) for w, m, S in zip(WEIGHTS, means, covs, strict=True)
    )
    np.testing.assert_allclose(info.planned_cov[-1], spread, atol=1e-8)


def test_costs_may_be_charged_at_the_start_of_a_step(x64, rng):
    problem = two_places()
    belief = mixture(rng)
    means = rng.normal(size=(1, 2, 4, 3))
    covs = jnp.stack([covs_of(belief), 2 * covs_of(belief)])
    at_start = mb.RiskSensitive(THETA, at_step_end=False)
    in_the_middle_too = replace(at_start, points_per_step=2)

    @quick_jit
    def state_costs(problem: mb.Problem, path_cost: mb.RiskSensitive) -> Array:
        schedules = GainSchedule(means, jnp.swapaxes(covs, 0, 1), means, means)
        controls = jnp.zeros((1, 2))
        plan = MixturePlan(problem, path_cost, belief, schedules, controls, "filter")
        return plan.state_costs(jnp.asarray(means))

    computed = state_costs(problem, at_start)
    averaged = state_costs(problem, in_the_middle_too)
    first = 0.1 * charged(problem, belief.means, covs[0])
    for i in range(3):
        last = mixture_terminal(problem, WEIGHTS, jnp.asarray(means[0, :, :, i]), covs[1])
        np.testing.assert_allclose(computed[i], first + last, rtol=1e-10)
        middle = 0.1 * charged(problem, (belief.means + means[0, :, :, i]) / 2, 1.5 * covs[0])
        np.testing.assert_allclose(averaged[i], (first + middle) / 2 + last, rtol=1e-10)


@pytest.mark.parametrize(
    ("word", "reason"),
    [
        ("prior_modes=[[1,2]]", r"problem\.prior_modes has shape \(1, 2\), must be \(1, 1\)"),
        ("prior_modes=[]", r"problem\.prior_modes has shape \(0, 0\), must be \(1, 1\)"),
        ("prior_modes=[1]", r"problem\.prior_modes must have 2 dimension"),
        ("prior_weights=[1,2]", r"problem\.prior_weights has shape \(2,\), must be \(1,\)"),
        ("prior_weights=[0]", r"problem\.prior_weights must be greater than 0 everywhere"),
    ],
)
def test_modes_that_do_not_fit_are_named(word, reason):
    with pytest.raises(ConfigError, match=f"^{reason}"):
        check(compose("system=scalar_linear", f"+problem.{word}"))
