"""Rules of Remark 4's moments, beside slow versions in NumPy."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import mppi_belief as mb
from helpers import light_dark_problem, plain_problem, quick_jit, random_spd
from mppi_belief.belief import cost as belief_cost
from mppi_belief.belief.moment_rules import RULES, MomentRules, check_spread, moments_by_rule

MEAN = np.array([2.5, 0.6, 0.3, -0.2])
APPROXIMATE = ("sigma_points", "delta", "at_mean")
THETA = 0.7
Q_WEIGHT = np.array([1.5, 1.5, 0.6, 0.6])
GOAL = np.array([7.0, 0, 0, 0])
CENTERS = np.array([[3.0, 1], [3, -1]])

risk_sensitive = quick_jit(belief_cost.risk_sensitive, static_argnames=("variance_of", "rules"))
mixture_risk_sensitive = quick_jit(
    belief_cost.mixture_risk_sensitive, static_argnames=("variance_of", "rules")
)
running_moments = quick_jit(belief_cost.running_moments)


def computed_moments(
    function: Callable[[Array], Array], mean: Any, cov: Any, rule: str, spread: float = 4.0
) -> np.ndarray:
    """Expectation and variance by a rule, as compiled functions of numbers that are not known."""

    def both(mean: Array, cov: Array, spread: Array) -> Array:
        return jnp.stack(moments_by_rule(function, mean, cov, rule, spread))

    return np.asarray(quick_jit(both)(jnp.asarray(mean), jnp.asarray(cov), spread))


def base(x: np.ndarray) -> float:
    return 0.5 * Q_WEIGHT @ (x - GOAL) ** 2


def bumps(x: np.ndarray) -> float:
    return 500 * sum(np.exp(-np.sum((x[:2] - z) ** 2) / (2 * 0.285**2)) for z in CENTERS)


def total(x: np.ndarray) -> float:
    return base(x) + bumps(x)


def by_sigma_points(
    function: Callable[[np.ndarray], float],
    mean: np.ndarray,
    cov: np.ndarray,
    spread: float,
    count: int,
) -> tuple[float, float]:
    """The mean and 2 `count` points for the first components, those of all states written out."""
    root = np.linalg.cholesky(cov)
    points = [mean]
    weights = [1 - count / spread]
    for j in range(count):
        for sign in (1, -1):
            points.append(mean + sign * np.sqrt(spread) * root[:, j])
            weights.append(1 / (2 * spread))
    values = np.array([function(x) for x in points])
    expectation = np.dot(weights, values)
    return expectation, np.dot(weights, (values - expectation) ** 2)


@pytest.mark.parametrize("spread", [2.0, 3.0, 4.0, 7.5])
def test_sigma_points_of_the_position_are_those_of_its_own_covariance(spread, light_dark, x64, rng):
    cov = random_spd(rng, 4, 0.02, 0.3)
    expected = by_sigma_points(bumps, MEAN, cov, spread, 2)
    computed = computed_moments(light_dark.penalty, MEAN, cov, "sigma_points", spread)
    np.testing.assert_allclose(computed, expected, rtol=1e-11)


def test_sigma_points_of_the_position_are_the_cubature_rule_over_all_four_states(
    light_dark, x64, rng
):
    """The points along the other two columns leave the position at the mean: 1 - 2/4 of the
    weight.
    """
    cov = random_spd(rng, 4, 0.02, 0.3)
    expected = by_sigma_points(bumps, MEAN, cov, 4.0, 4)
    computed = computed_moments(light_dark.penalty, MEAN, cov, "sigma_points")
    np.testing.assert_allclose(computed, expected, rtol=1e-11)


def test_the_position_may_lie_anywhere_in_the_state(x64, rng):
    """With the position last, the square root is that of the reordered covariance."""
    order = [2, 3, 0, 1]
    cov = random_spd(rng, 4, 0.02, 0.3)
    expected = by_sigma_points(bumps, MEAN, cov, 3.0, 2)
    problem = light_dark_problem()

    def reordered(x: Array) -> Array:
        return problem.penalty(x[jnp.array(order)])

    computed = computed_moments(
        reordered, MEAN[order], cov[np.ix_(order, order)], "sigma_points", 3.0
    )
    np.testing.assert_allclose(computed, expected, rtol=1e-11)


@pytest.mark.parametrize("nx", [1, 3, 6])
def test_the_delta_rule_has_the_derivatives_of_finite_differences(nx, x64, rng):
    mean = rng.normal(size=nx)
    cov = random_spd(rng, nx, 0.02, 0.3)
    slope = rng.normal(size=nx)

    def function(x: Array) -> Array:
        return jnp.exp(0.3 * slope @ x) * jnp.cos(x[0])

    h = 1e-4
    steps = h * np.eye(nx)

    def value(x: np.ndarray) -> float:
        return float(np.exp(0.3 * slope @ x) * np.cos(x[0]))

    gradient = np.array([(value(mean + e) - value(mean - e)) / (2 * h) for e in steps])
    hessian = np.empty((nx, nx))
    for i, e in enumerate(steps):
        for j, d in enumerate(steps):
            mixed = value(mean + e + d) - value(mean + e - d) - value(mean - e + d)
            hessian[i, j] = (mixed + value(mean - e - d)) / (4 * h**2)
    expected = [value(mean) + 0.5 * np.sum(hessian * cov), gradient @ cov @ gradient]
    computed = computed_moments(function, mean, cov, "delta")
    np.testing.assert_allclose(computed, expected, rtol=1e-5)


def test_at_the_mean_is_the_value_there_without_variance(light_dark, x64, rng):
    computed = computed_moments(light_dark.penalty, MEAN, random_spd(rng, 4), "at_mean")
    np.testing.assert_allclose(computed, [bumps(MEAN), 0.0], rtol=1e-12)


@pytest.mark.parametrize("rule", ["sigma_points", "delta"])
@pytest.mark.parametrize("components", [[0], [2, 0], [0, 1, 2, 3, 4]])
def test_the_expectation_of_a_quadratic_is_exact(rule, components, x64, rng):
    n = len(components)
    W = random_spd(rng, n)
    mean = rng.normal(size=5)
    cov = random_spd(rng, 5)
    chosen = jnp.array(components)

    def function(x: Array) -> Array:
        return 0.5 * x[chosen] @ W @ x[chosen] - x[chosen[0]]

    part = mean[components]
    exact = (
        0.5 * part @ W @ part - part[0] + 0.5 * np.trace(W @ cov[np.ix_(components, components)])
    )
    expectation, _ = computed_moments(function, mean, cov, rule, 5.5)
    np.testing.assert_allclose(expectation, exact, rtol=1e-11)


@pytest.mark.parametrize("rule", APPROXIMATE)
def test_no_variance_is_negative_and_a_certain_state_has_none(rule, light_dark, rng):
    """In single precision; c as low as it may be, and covariances that are singular."""
    problem = light_dark_problem(cost={"w_obs": 1e4})
    for scale in (1e-8, 1e-3, 1.0, 1e3):
        root = rng.normal(size=(4, 3))
        cov = (scale * root @ root.T).astype(np.float32)
        mean = MEAN.astype(np.float32)
        _, variance = computed_moments(problem.penalty, mean, cov, rule, 2.0)
        assert variance >= 0
    certain = computed_moments(problem.penalty, mean, np.zeros((4, 4), np.float32), rule)
    np.testing.assert_array_equal(certain, [float(problem.penalty(jnp.asarray(mean))), 0.0])


@pytest.mark.parametrize("rule", APPROXIMATE)
def test_a_constant_has_itself_for_expectation(rule):
    computed = computed_moments(lambda x: jnp.asarray(3.0), MEAN, np.eye(4), rule)
    np.testing.assert_array_equal(computed, [3.0, 0.0])


def test_derivatives_that_are_not_finite_count_as_zero(x64):
    """At the end of a distance, of which the first component alone is certain."""
    cov = np.diag([0.0, 0.3])
    computed = computed_moments(lambda x: jnp.sqrt(x @ x) + x[1], np.zeros(2), cov, "delta")
    assert np.all(np.isfinite(computed))


@pytest.mark.parametrize("expectation", RULES)
@pytest.mark.parametrize("variance", RULES)
@pytest.mark.parametrize("variance_of", ["penalty", "total"])
def test_the_cost_takes_each_moment_by_its_own_rule(
    expectation, variance, variance_of, light_dark, x64, rng
):
    cov = random_spd(rng, 4, 0.02, 0.3)
    exact = running_moments(light_dark, MEAN, cov)
    function = {"penalty": bumps, "total": total}[variance_of]
    count = {"penalty": 2, "total": 4}[variance_of]
    gradient, hessian = derivatives_of_bumps(MEAN)
    slope = gradient if variance_of == "penalty" else gradient + Q_WEIGHT * (MEAN - GOAL)
    total_var = exact.base_var + 2 * exact.covariance + exact.penalty_var
    penalties = {
        "exact": exact.penalty,
        "sigma_points": by_sigma_points(bumps, MEAN, cov, 5.0, 2)[0],
        "delta": bumps(MEAN) + 0.5 * np.sum(hessian * cov),
        "at_mean": bumps(MEAN),
    }
    variances = {
        "exact": exact.penalty_var if variance_of == "penalty" else total_var,
        "sigma_points": by_sigma_points(function, MEAN, cov, 5.0, count)[1],
        "delta": slope @ cov @ slope,
        "at_mean": 0.0,
    }
    rules = MomentRules(expectation, variance, 5.0)
    computed = risk_sensitive(light_dark, MEAN, cov, THETA, variance_of=variance_of, rules=rules)
    expected = exact.base + penalties[expectation] + 0.5 * THETA * variances[variance]
    np.testing.assert_allclose(computed, expected, rtol=1e-10)


def derivatives_of_bumps(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradient and Hessian of the bumps, by hand."""
    gradient = np.zeros(4)
    hessian = np.zeros((4, 4))
    for z in CENTERS:
        d = (x[:2] - z) / 0.285**2
        value = 500 * np.exp(-np.sum((x[:2] - z) ** 2) / (2 * 0.285**2))
        gradient[:2] -= value * d
        hessian[:2, :2] += value * (np.outer(d, d) - np.eye(2) / 0.285**2)
    return gradient, hessian


@pytest.mark.parametrize("variance_of", ["penalty", "total"])
def test_a_mixture_has_the_variance_within_and_between_its_components(
    variance_of, light_dark, x64, rng
):
    weights = np.array([0.3, 0.7])
    means = MEAN + 0.4 * rng.normal(size=(2, 4))
    covs = np.array([random_spd(rng, 4, 0.02, 0.3) for _ in weights])
    function = {"penalty": bumps, "total": total}[variance_of]
    count = {"penalty": 2, "total": 4}[variance_of]
    moments = [
        by_sigma_points(function, mean, cov, 4.0, count)
        for mean, cov in zip(means, covs, strict=True)
    ]
    expectations, within = np.array(moments).T
    between = weights @ (expectations - weights @ expectations) ** 2
    bases = [
        base(mean) + 0.5 * Q_WEIGHT @ np.diag(cov) for mean, cov in zip(means, covs, strict=True)
    ]
    penalties = [bumps(mean) for mean in means]
    rules = MomentRules("at_mean", "sigma_points")
    computed = mixture_risk_sensitive(
        light_dark, weights, means, covs, THETA, variance_of=variance_of, rules=rules
    )
    expected = weights @ bases + weights @ penalties + 0.5 * THETA * (weights @ within + between)
    np.testing.assert_allclose(computed, expected, rtol=1e-11)


def test_a_cost_without_closed_form_has_the_same_rules(x64, rng):
    @mb.struct
    class Fence:
        """Charges the distance beyond a line; no moments in closed form."""

        R = np.eye(2)
        goal = np.zeros(2)

        def base(self, x: Array) -> Array:
            return x @ x

        def penalty(self, x: Array, surroundings: mb.Surroundings) -> Array:
            return jnp.maximum(0.0, x[1] - 0.5)

        def terminal(self, x: Array) -> Array:
            return x @ x

    cov = random_spd(rng, 2)
    mean = np.array([0.3, 0.2])
    step = np.sqrt(4.0 * cov[1, 1])
    charged = max(0.0, 0.2 + step - 0.5)
    expectation = charged / 8
    variance = 6 / 8 * expectation**2 + (charged - expectation) ** 2 / 8 + expectation**2 / 8
    computed = risk_sensitive(
        plain_problem(Fence()), mean, cov, 2.0, rules=MomentRules("sigma_points", "sigma_points")
    )
    expected = mean @ mean + np.trace(cov) + expectation + variance
    np.testing.assert_allclose(computed, expected, rtol=1e-11)


def test_a_spread_below_the_number_of_components_is_refused(light_dark):
    with pytest.raises(ValueError, match=r"^sigma_point_spread must be at least 2, .*, got 1\.9$"):
        check_spread(light_dark.penalty, jnp.asarray(MEAN), 1.9)
    check_spread(light_dark.penalty, jnp.asarray(MEAN), 2.0)
    points = {"variance": "sigma_points", "sigma_point_spread": 3.0}
    mb.RiskSensitive(**points).check_fit(light_dark)
    with pytest.raises(ValueError, match="must be at least 4"):
        mb.RiskSensitive(variance_of="total", **points).check_fit(light_dark)
    mb.RiskSensitive(variance_of="total", sigma_point_spread=3.0).check_fit(light_dark)
    with pytest.raises(ValueError, match="must be at least 2"):
        mb.RiskSensitive(expectation="sigma_points", sigma_point_spread=1.0).check_fit(light_dark)


@pytest.mark.parametrize("field", ["expectation", "variance"])
def test_another_rule_is_refused_by_name(field):
    with pytest.raises(
        ValueError, match=f"{field} must be one of exact, sigma_points, delta, at_mean"
    ):
        mb.RiskSensitive(**{field: "unscented"})
    assert not mb.RiskSensitive().expands_cost
    assert mb.RiskSensitive(**{field: "delta"}).expands_cost
