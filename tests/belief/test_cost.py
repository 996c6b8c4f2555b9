"""Costs of a belief: eqs. (3), (4), Remark 4, and who computes the moments."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import mppi_belief as mb
from helpers import plain_problem, quick_jit, random_spd
from mppi_belief.belief import cost as belief_cost
from mppi_belief.belief.moment_rules import MomentRules
from mppi_belief.problem import ClosedFormCost, Cost

MEAN = np.array([2.5, 0.6, 0.3, -0.2])
risk_sensitive = quick_jit(belief_cost.risk_sensitive, static_argnames=("variance_of", "rules"))
running_moments = quick_jit(belief_cost.running_moments)


@mb.struct
class Quartic:
    """A cost that does not know its moments: base |x|^2, penalty x_0 x_1, terminal x_0^4."""

    control_weight: Array = mb.array(ndim=2)

    @property
    def R(self) -> Array:
        return jnp.asarray(self.control_weight)

    @property
    def goal(self) -> Array:
        return jnp.zeros(2)

    def base(self, x: Array) -> Array:
        return x @ x

    def penalty(self, x: Array, surroundings: mb.Surroundings) -> Array:
        return x[0] * x[1]

    def terminal(self, x: Array) -> Array:
        return x[0] ** 4


@mb.struct
class Oracle(Quartic):
    """The same with made-up moments, to see who is asked."""

    def running_moments(
        self, mean: Array, cov: Array, surroundings: mb.Surroundings
    ) -> mb.CostMoments:
        return mb.CostMoments(*(jnp.asarray(float(v)) for v in (1, 10, 100, 1000, 10000)))

    def terminal_mean(self, mean: Array, cov: Array) -> Array:
        return jnp.asarray(-1.0)


def test_a_cost_without_closed_form_is_integrated(x64):
    cost = Quartic(np.eye(2))
    m = np.array([0.5, -1.0])
    S = np.array([[0.4, 0.1], [0.1, 0.2]])
    assert isinstance(cost, Cost)
    assert not isinstance(cost, ClosedFormCost)
    problem = plain_problem(cost)
    computed = running_moments(problem, m, S)
    # Isserlis' theorem; all of these are of degree four at most, so the rule is exact
    W = np.eye(2)
    V = np.array([[0, 0.5], [0.5, 0]])
    np.testing.assert_allclose(computed.base, m @ m + np.trace(S), rtol=1e-12)
    np.testing.assert_allclose(computed.penalty, m[0] * m[1] + S[0, 1], rtol=1e-12)
    for value, (A, B) in (
        (computed.base_var, (W, W)),
        (computed.penalty_var, (V, V)),
        (computed.covariance, (W, V)),
    ):
        np.testing.assert_allclose(
            value, 2 * np.trace(A @ S @ B @ S) + 4 * m @ A @ S @ B @ m, rtol=1e-12
        )
    terminal = belief_cost.expected_terminal(problem, jnp.asarray(m), jnp.asarray(S))
    np.testing.assert_allclose(
        terminal, m[0] ** 4 + 6 * m[0] ** 2 * S[0, 0] + 3 * S[0, 0] ** 2, rtol=1e-12
    )


def test_a_cost_that_knows_its_moments_is_asked():
    cost = Oracle(np.eye(2))
    m = jnp.ones(2)
    S = jnp.eye(2)
    assert isinstance(cost, ClosedFormCost)
    problem = plain_problem(cost)
    moments = belief_cost.running_moments(problem, m, S)
    assert [float(v) for v in moments] == [1, 10, 100, 1000, 10000]
    assert belief_cost.expected_terminal(problem, m, S) == -1
    assert belief_cost.risk_sensitive(problem, m, S, 2.0, "penalty") == 11 + 1000
    assert belief_cost.risk_sensitive(problem, m, S, 2.0, "total") == 11 + 100 + 2 * 10000 + 1000


def test_without_risk_aversion_the_expectation_is_left(light_dark, x64, rng):
    cov = 0.05 * random_spd(rng, 4)
    m = running_moments(light_dark, MEAN, cov)
    for risk in ("penalty", "total"):
        np.testing.assert_allclose(
            risk_sensitive(light_dark, MEAN, cov, 0.0, variance_of=risk),
            m.base + m.penalty,
            rtol=1e-13,
        )


def test_risk_sensitive_cost_is_remark_4(light_dark, x64, rng):
    cov = 0.05 * random_spd(rng, 4)
    m = running_moments(light_dark, MEAN, cov)
    for theta in (0.5, 1.0, 5.0):
        penalty, total = (
            risk_sensitive(light_dark, MEAN, cov, theta, variance_of=risk)
            for risk in ("penalty", "total")
        )
        mean = m.base + m.penalty
        np.testing.assert_allclose(penalty, mean + theta / 2 * m.penalty_var, rtol=1e-13)
        np.testing.assert_allclose(
            total, mean + theta / 2 * (m.base_var + 2 * m.covariance + m.penalty_var), rtol=1e-13
        )


@pytest.mark.parametrize("risk", ["penalty", "total"])
def test_the_penalty_expected_at_the_mean_is_its_value_there_and_nothing_else_changes(
    risk, light_dark, x64, rng
):
    cov = 0.05 * random_spd(rng, 4)
    m = running_moments(light_dark, MEAN, cov)
    there = float(light_dark.penalty(jnp.asarray(MEAN)))
    variance = m.penalty_var if risk == "penalty" else m.base_var + 2 * m.covariance + m.penalty_var
    assert abs(m.penalty - there) > 1
    for theta in (0.0, 0.5, 5.0):
        exact, default, at_mean = (
            risk_sensitive(light_dark, MEAN, cov, theta, variance_of=risk, **given)
            for given in ({"rules": MomentRules("exact")}, {}, {"rules": MomentRules("at_mean")})
        )
        assert exact == default
        np.testing.assert_allclose(exact, m.base + m.penalty + theta / 2 * variance, rtol=1e-12)
        np.testing.assert_allclose(at_mean, m.base + there + theta / 2 * variance, rtol=1e-12)


def test_without_risk_aversion_paths_differ_by_their_cost_at_the_mean(light_dark, x64, rng):
    """What is left of the covariance is the same for all paths: differences are those of
    CE-MPPI.
    """
    covs = [0.05 * random_spd(rng, 4) for _ in range(3)]
    paths = MEAN + rng.normal(size=(5, 3, 4)) * [1.0, 0.6, 0.5, 0.5]

    def along(expectation: str) -> np.ndarray:
        totals = [
            sum(
                float(risk_sensitive(light_dark, x, cov, 0.0, rules=MomentRules(expectation)))
                for x, cov in steps
            )
            for steps in (zip(path, covs, strict=True) for path in paths)
        ]
        return np.diff(totals)

    certain = np.diff(
        [
            sum(
                float(belief_cost.certainty_equivalent(light_dark, x))
                for x in map(jnp.asarray, path)
            )
            for path in paths
        ]
    )
    np.testing.assert_allclose(along("at_mean"), certain, rtol=1e-9, atol=1e-9)
    assert np.all(np.abs(along("exact") - certain) > 1e-3 * np.abs(certain))


def test_a_planner_without_risk_aversion_that_expects_at_the_mean_is_ce_mppi(light_dark, x64):
    sizes = {"n_samples": 64, "horizon": 8, "sampler": mb.NominalSampler(control_std=2.75)}
    belief = mb.Belief(jnp.array([2.0, 0.5, 1.0, 0.0]), 0.05 * jnp.eye(4))
    act = quick_jit(
        lambda planner: planner.act(light_dark, belief, planner.init(light_dark), jax.random.key(1))
    )
    blind = act(mb.MPPI(**sizes, path_cost=mb.CertaintyEquivalent()))
    at_mean = act(mb.MPPI(**sizes, path_cost=mb.RiskSensitive(expectation="at_mean")))
    np.testing.assert_allclose(at_mean[2].weights, blind[2].weights, rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(at_mean[0], blind[0], rtol=1e-7)


def test_risk_sensitive_cost_is_the_start_of_the_entropic_one(x64):
    """log E exp(theta q) / theta = E q + theta / 2 Var q + O(theta^2), here for q = |x|^2 / 2 in
    closed form.
    """
    problem = plain_problem(mb.GoalObstacleCost([0.0], [1.0], [1.0], [1.0]))
    m = 0.7
    s = 0.4
    remainders = []
    for theta in (1e-2, 5e-3):
        entropic = (m**2 * theta / (2 * (1 - theta * s)) - 0.5 * np.log(1 - theta * s)) / theta
        q_rs = risk_sensitive(problem, np.array([m]), np.array([[s]]), theta, variance_of="total")
        remainders.append(entropic - q_rs)
    np.testing.assert_allclose(np.log2(remainders[0] / remainders[1]), 2, atol=0.05)


@pytest.mark.parametrize("risk", ["penalty", "total"])
def test_a_certain_belief_costs_what_its_mean_does(risk, light_dark, x64):
    for position in (MEAN, np.array([3.0, 1.0, 0, 0]), np.zeros(4)):
        computed = risk_sensitive(light_dark, position, jnp.zeros((4, 4)), 5.0, variance_of=risk)
        certain = belief_cost.certainty_equivalent(light_dark, jnp.asarray(position))
        np.testing.assert_allclose(computed, certain, rtol=1e-12)
    cost = light_dark.cost
    np.testing.assert_allclose(
        certain, cost.base(jnp.zeros(4)) + light_dark.penalty(jnp.zeros(4)), rtol=1e-12
    )


def test_expected_terminal_cost_is_eq_4(light_dark, x64, rng):
    cov = random_spd(rng, 4)
    computed = belief_cost.expected_terminal(light_dark, MEAN, cov)
    weight = np.diag(light_dark.cost.terminal_weight)
    np.testing.assert_allclose(
        computed, light_dark.cost.terminal(MEAN) + 0.5 * np.trace(weight @ cov), rtol=1e-12
    )


def test_more_risk_aversion_never_costs_less(light_dark, x64, rng):
    cov = 0.05 * random_spd(rng, 4)
    costs = [
        risk_sensitive(light_dark, MEAN, cov, theta, variance_of="penalty")
        for theta in (0.0, 0.5, 1.0, 2.0)
    ]
    assert costs == sorted(costs)
