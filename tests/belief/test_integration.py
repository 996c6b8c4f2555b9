"""Moments of costs without closed form: exact, or over the components that a cost depends on."""

import warnings
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array
from scipy.special import expit

from helpers import plain_problem, quick_jit, random_spd
from mppi_belief.belief import cost as belief_cost
from mppi_belief.belief.integration import (
    ManyNodesWarning,
    covariance,
    expected_value,
    integrand,
    variance,
)
from user_parts import Danger

integrated_moments = quick_jit(belief_cost.integrated_moments)
running_moments = quick_jit(belief_cost.running_moments)
expected_terminal = quick_jit(belief_cost.expected_terminal)


def moments(function: Callable[[Array], Array], mean: Any, cov: Any) -> np.ndarray:
    """Expectation and variance of a function of a Gaussian state."""

    def both(mean: Array, cov: Array) -> Array:
        f = integrand(function, mean, cov, "f")
        return jnp.stack([expected_value(f), variance(f)])

    return np.asarray(quick_jit(both)(jnp.asarray(mean), jnp.asarray(cov)))


@pytest.mark.parametrize("nx", [1, 4, 5, 6, 8, 12])
@pytest.mark.parametrize("edge", [1.0, 2.5, 2.9, 3.2])
def test_a_penalty_beside_a_wall_is_expected_as_it_is(nx, edge, x64):
    """A rule of degree 5 over all states gives -1.56 for 0.64 at five states and an edge of 2.5."""
    problem = plain_problem(Danger(np.zeros(nx), edge))
    computed = integrated_moments(problem, jnp.zeros(nx), jnp.eye(nx))
    x = np.linspace(-9, 9, 20001)
    density = np.exp(-0.5 * x**2) / np.sum(np.exp(-0.5 * x**2))
    penalty = 100 * expit((x - edge) / 0.05)
    mean = penalty @ density
    assert float(computed.penalty) == pytest.approx(mean, rel=0.07)
    assert float(computed.penalty_var) == pytest.approx((penalty - mean) ** 2 @ density, rel=0.1)
    last = expected_terminal(problem, jnp.zeros(nx), jnp.eye(nx))
    assert float(last) == pytest.approx(mean, rel=0.07)


@pytest.mark.parametrize("nx", range(1, 13))
def test_no_moment_of_a_cost_of_all_states_is_negative(nx, rng):
    """In single precision, and with covariances that are singular."""

    root = rng.normal(size=(nx, max(1, nx - 1)))
    cov = (root @ root.T).astype(np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ManyNodesWarning)
        computed = moments(
            lambda x: jnp.maximum(jnp.sum(x) - 2.0, 0.0) ** 1.5, np.zeros(nx, np.float32), cov
        )
    assert np.all(computed >= 0)


@pytest.mark.parametrize("n", [1, 3, 6, 9])
def test_mean_and_variance_of_a_quadratic_are_exact_for_any_gaussian(n, x64, rng):
    mean, slope = rng.normal(size=(2, n))
    cov = random_spd(rng, n, 0.01, 2.0)
    W = rng.normal(size=(n, n))
    W = W + W.T
    computed = moments(lambda x: 0.5 * x @ W @ x + slope @ x, mean, cov)
    gradient = W @ mean + slope
    expectation = 0.5 * mean @ W @ mean + slope @ mean + 0.5 * np.trace(W @ cov)
    exact_variance = 0.5 * np.trace(W @ cov @ W @ cov) + gradient @ cov @ gradient
    np.testing.assert_allclose(computed, [expectation, exact_variance], rtol=1e-11)


def test_the_centred_isotropic_quadratic_is_not_without_variance(x64):
    """Where the rules with 2n points fail: all of those points lie on one level set."""
    np.testing.assert_allclose(moments(lambda x: x @ x, np.zeros(2), np.eye(2)), [2, 4], rtol=1e-12)


@pytest.mark.parametrize("components", [[0], [4, 1], [1, 2, 5], [5, 4, 3, 2], [0, 1, 2, 3, 4]])
def test_a_function_of_some_components_is_integrated_over_their_marginal(components, x64, rng):
    """A sum to the fourth power is exact to degree 5; its variance is of degree 8."""
    cov = random_spd(rng, 6, 0.1, 1.0)
    mean = rng.normal(size=6)
    chosen = np.array(components)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ManyNodesWarning)
        computed = moments(lambda x: jnp.sum(x[chosen]) ** 4, mean, cov)[0]
    m = mean[chosen].sum()
    v = cov[np.ix_(chosen, chosen)].sum()
    np.testing.assert_allclose(computed, m**4 + 6 * m**2 * v + 3 * v**2, rtol=1e-10)


@pytest.mark.parametrize("precise", [True, False])
def test_a_singular_covariance_is_integrated_over_its_range(precise, request):
    if precise:
        request.getfixturevalue("x64")
    direction = np.array([1.0, -2.0, 0.5])
    cov = np.outer(direction, direction)
    # 1 + 6 s^2 + 3 s^4 with s the sum of the direction
    computed = moments(lambda x: (1 + jnp.sum(x)) ** 4, jnp.zeros(3), cov)[0]
    rtol = 1e-12 if precise else 1e-5
    np.testing.assert_allclose(computed, 1 + 6 * 0.5**2 + 3 * 0.5**4, rtol=rtol)
    certain = moments(lambda x: (1 + jnp.sum(x)) ** 4, jnp.zeros(3), 0 * cov)
    np.testing.assert_allclose(certain, [1, 0], rtol=1e-6, atol=1e-12)


def test_a_function_and_a_quadratic_of_other_components_are_correlated(x64, rng):
    """Cov[a x_0 + x_1^2, x_2^3] by Isserlis' theorem."""
    cov = random_spd(rng, 3, 0.1, 1.0)
    mean = rng.normal(size=3)

    def both(mean: Array, cov: Array) -> Array:
        quadratic = integrand(lambda x: 2 * x[0] + x[1] ** 2, mean, cov, "q")
        cube = integrand(lambda x: x[2] ** 3, mean, cov, "f")
        return jnp.stack([covariance(quadratic, cube), covariance(cube, quadratic)])

    m = mean[2]
    v = cov[2, 2]
    # Cov[x_i, x_2^3] = 3 E[x_2^2] S_i2, and twice the mean of x_1 of that for its square's slope.
    slope = 3 * (m**2 + v)
    expected = 2 * slope * cov[0, 2] + 2 * mean[1] * slope * cov[1, 2] + 6 * m * cov[1, 2] ** 2
    np.testing.assert_allclose(quick_jit(both)(mean, cov), expected, rtol=1e-11)


def test_the_moments_of_the_light_dark_cost_are_close_to_its_closed_form(light_dark, x64, rng):
    """With a spread of up to a third of a bump's width every moment is right to a percent."""
    mean = np.array([2.5, 0.6, 0.3, -0.2])
    for spread in (0.02, 0.1):
        cov = spread**2 * random_spd(rng, 4)
        exact = running_moments(light_dark, mean, cov)
        computed = integrated_moments(light_dark, mean, jnp.asarray(cov))
        np.testing.assert_allclose(computed, exact, rtol=1e-2)
        np.testing.assert_allclose(
            [computed.base, computed.base_var], [exact.base, exact.base_var], rtol=1e-10
        )


def test_moments_are_the_same_under_every_map_over_samples(x64, rng):
    problem = plain_problem(Danger(np.zeros(3), 1.0))
    means = jnp.asarray(rng.normal(size=(3, 5)))
    covs = jnp.asarray([random_spd(rng, 3) for _ in range(5)])
    mapped = jax.vmap(integrated_moments, in_axes=(None, 1, 0))(problem, means, covs)
    for i in range(5):
        alone = integrated_moments(problem, means[:, i], covs[i])
        np.testing.assert_allclose([part[i] for part in mapped], alone, rtol=1e-10)


def test_a_function_of_many_components_is_named_in_a_warning():
    def everything(x: Array) -> Array:
        return jnp.tanh(jnp.sum(x))

    with pytest.warns(ManyNodesWarning, match="^cost.penalty of Mine depends on 6 components"):
        integrand(everything, jnp.zeros(6), jnp.eye(6), "cost.penalty of Mine")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        integrand(everything, jnp.zeros(3), jnp.eye(3), "f")
        integrand(lambda x: x @ x, jnp.zeros(12), jnp.eye(12), "f")
        integrand(lambda x: everything(x[9:]), jnp.zeros(12), jnp.eye(12), "f")
