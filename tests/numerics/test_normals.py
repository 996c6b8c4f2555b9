"""Normals that are normal, independent, and a function of their key."""

import jax
import jax.extend
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import special, stats

from mppi_belief.numerics.normals import erf_inv, standard_normal, threefry_2x32

COUNT = 200_000


def draw(seed: int = 0, shape: tuple[int, ...] = (COUNT,)) -> np.ndarray:
    return np.asarray(standard_normal(jax.random.key(seed), shape), dtype=np.float64)


@pytest.mark.parametrize("seed", range(5))
def test_their_distribution_is_normal(seed):
    x = draw(seed)
    assert stats.kstest(x, "norm").pvalue > 1e-4
    # moments against their standard errors
    for power, moment, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)):
        assert abs(np.mean(x**power) - moment) < 4.5 * np.sqrt(variance / COUNT)


def test_tails_reach_as_far_as_23_bits_do_and_no_further():
    x = draw(shape=(4_000_000,))
    assert np.all(np.isfinite(x))
    assert 4.8 < np.abs(x).max() < 5.4
    beyond = np.sum(np.abs(x) > 4)
    expected = len(x) * 2 * stats.norm.sf(4)
    assert abs(beyond - expected) < 4.5 * np.sqrt(expected)


def test_neighbours_rows_and_keys_are_uncorrelated():
    x = draw(0, (400, 500))
    y = draw(1, (400, 500))
    for a, b in ((x[:, :-1], x[:, 1:]), (x[:-1], x[1:]), (x, y), (x[:, :250], x[:, 250:])):
        assert abs(np.mean(a * b)) < 4.5 / np.sqrt(a.size)


def test_the_same_key_gives_the_same_bits_compiled_or_not():
    compiled = jax.jit(lambda key: standard_normal(key, (64,)))(jax.random.key(3))
    np.testing.assert_array_equal(compiled, draw(3, (64,)).astype(np.float32))


def test_double_precision_has_double_digits(x64):
    x = standard_normal(jax.random.key(0), (1000,))
    assert x.dtype == jnp.float64
    assert np.any(np.asarray(x) != np.asarray(x).astype(np.float32))


def test_double_precision_normals_are_those_of_jax(x64):
    for seed, shape in ((0, (1000,)), (1, (3, 5, 7)), (2, (1,))):
        key = jax.random.key(seed)
        np.testing.assert_allclose(
            standard_normal(key, shape), jax.random.normal(key, shape), rtol=4e-16, atol=0
        )


@pytest.mark.parametrize("n", [1, 2, 7, 1000])
def test_the_bits_are_those_of_jax(n):
    words = jax.random.key_data(jax.random.key(n + 2**31))
    wanted = jax.extend.random.threefry_2x32(words, jnp.arange(n, dtype=jnp.uint32))
    np.testing.assert_array_equal(threefry_2x32(words, n), wanted)


def test_the_inverse_of_the_error_function_is_accurate_to_its_tails():
    """At all the numbers it is ever given near 0 and near 1, and at many between."""
    cells = np.unique(
        np.r_[0:3000, 0 : 2**23 : 997, 2**22 - 3000 : 2**22 + 3000, 2**23 - 3000 : 2**23]
    )
    x = ((cells.astype(np.float32) + np.float32(0.5)) * np.float32(2**-22) - np.float32(1)).astype(
        np.float32
    )
    wanted = special.erfinv(x.astype(float))
    error = np.abs(np.asarray(jax.jit(erf_inv)(x), dtype=float) / wanted - 1)
    assert error.max() < 3e-7
