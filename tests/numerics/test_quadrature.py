"""The cubature rule: exact to degree 5, and no further."""

from itertools import combinations_with_replacement

import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

from helpers import quick_jit, random_spd
from mppi_belief.numerics import quadrature


def normal_moment(powers: np.ndarray) -> float:
    """E prod x_i^p_i for independent standard normals: a product of double factorials."""
    return float(np.prod([0 if p % 2 else np.prod(np.arange(p - 1, 0, -2)) for p in powers]))


@pytest.mark.parametrize("n", range(1, 7))
def test_every_monomial_up_to_degree_five_is_exact(n):
    points, weights = quadrature.degree_five_rule(n)
    assert points.shape == (2 * n**2 + 1, n)
    assert weights.shape == (2 * n**2 + 1,)
    for degree in range(6):
        for factors in combinations_with_replacement(range(n), degree):
            powers = np.bincount(factors, minlength=n)
            computed = weights @ np.prod(points**powers, axis=1)
            assert computed == pytest.approx(normal_moment(powers), abs=1e-12), powers


@pytest.mark.parametrize("n", [2, 4])
def test_degree_six_is_beyond_the_rule(n):
    points, weights = quadrature.degree_five_rule(n)
    assert abs(weights @ points[:, 0] ** 6 - 15) > 1


@pytest.mark.parametrize("n", range(1, 7))
def test_weights_are_non_negative_up_to_four_dimensions(n):
    assert (quadrature.degree_five_rule(n)[1].min() >= 0) == (n <= 4)


@pytest.mark.parametrize("n", [1, 3, 6])
def test_mean_and_variance_of_a_quadratic_are_exact_for_any_gaussian(n, x64, rng):
    mean, slope = rng.normal(size=(2, n))
    cov = random_spd(rng, n, 0.01, 2.0)
    W = rng.normal(size=(n, n))
    W = W + W.T

    def integrate(mean: Array, cov: Array) -> tuple[Array, Array]:
        return quadrature.evaluate_at_nodes(lambda x: 0.5 * x @ W @ x + slope @ x, mean, cov)

    values, weights = quick_jit(integrate)(mean, cov)
    expectation = weights @ values
    gradient = W @ mean + slope
    np.testing.assert_allclose(
        expectation, 0.5 * mean @ W @ mean + slope @ mean + 0.5 * np.trace(W @ cov), rtol=1e-11
    )
    variance = 0.5 * np.trace(W @ cov @ W @ cov) + gradient @ cov @ gradient
    np.testing.assert_allclose(weights @ (values - expectation) ** 2, variance, rtol=1e-11)


def test_the_centred_isotropic_quadratic_is_not_without_variance(x64):
    """Where the rules with 2n points fail: all of those points lie on one level set."""
    values, weights = quick_jit(
        lambda S: quadrature.evaluate_at_nodes(lambda x: x @ x, jnp.zeros(2), S)
    )(jnp.eye(2))
    np.testing.assert_allclose(weights @ (values - 2) ** 2, 4, rtol=1e-12)


@pytest.mark.parametrize("precise", [True, False])
def test_a_singular_covariance_is_integrated_over_its_range(precise, request):
    if precise:
        request.getfixturevalue("x64")
    direction = np.array([1.0, -2.0, 0.5])
    cov = jnp.asarray(np.outer(direction, direction))
    expectation = quick_jit(
        lambda c: quadrature.expectation(lambda x: (1 + jnp.sum(x)) ** 4, jnp.zeros(3), c)
    )
    # 1 + 6 s^2 + 3 s^4 with s the sum of the direction
    np.testing.assert_allclose(
        expectation(cov), 1 + 6 * 0.5**2 + 3 * 0.5**4, rtol=1e-12 if precise else 1e-5
    )
    np.testing.assert_allclose(expectation(0 * cov), 1, rtol=1e-6)
