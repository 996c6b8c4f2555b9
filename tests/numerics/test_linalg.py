"""Small matrices against NumPy, in both precisions and over bad scales."""

from contextlib import nullcontext

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers import float64, quick_jit, random_spd
from mppi_belief.numerics import linalg

PRECISIONS = {"float32": (nullcontext, np.float32), "float64": (float64, np.float64)}
inverse = quick_jit(linalg.spd_inverse)
largest_eigenvalue = quick_jit(linalg.largest_eigenvalue)
largest_deviation = quick_jit(linalg.largest_deviation)
precision = pytest.mark.parametrize("precision", PRECISIONS)


@precision
@pytest.mark.parametrize("n", [1, 2, 3])
@settings(max_examples=60, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_spd_inverse_under_any_units(n, precision, seed):
    """Units of 1e-6 to 1e6 per component, so entries of 1e-12 to 1e12, must not cost digits."""
    context, dtype = PRECISIONS[precision]
    rng = np.random.default_rng(seed)
    units = 10 ** rng.uniform(-6, 6, n)
    with context():
        M = (random_spd(rng, n, 0.1, 2.0) * np.outer(units, units)).astype(dtype)
        M = np.tril(M) + np.tril(M, -1).T
        computed = np.asarray(inverse(M))
    assert computed.dtype == dtype
    np.testing.assert_array_equal(computed, computed.T)
    units = np.sqrt(np.diag(M).astype(np.float64))
    expected = np.linalg.inv(M / np.outer(units, units))
    # The condition number is up to 20 in the natural units. LAPACK, used from n = 3 on, pivots by
    # the given units and loses digits.
    np.testing.assert_allclose(
        computed * np.outer(units, units), expected, atol=(60 if n < 3 else 2000) * eps(dtype)
    )


def eps(dtype: type) -> float:
    return float(np.finfo(dtype).eps)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), log_condition=st.floats(0, 9))
def test_spd_inverse_of_a_nearly_singular_matrix_stays_definite(seed, log_condition):
    rng = np.random.default_rng(seed)
    v = rng.normal(size=2)
    M = (np.outer(v, v) / (v @ v) * 10**log_condition + np.eye(2)).astype(np.float32)
    computed = np.asarray(inverse(M)).astype(np.float64)
    assert np.all(np.diag(computed) > 0)
    assert np.linalg.det(computed) >= -4 * eps(np.float32) * np.prod(np.diag(computed))


@pytest.mark.parametrize("seed", range(20))
def test_log_det_1p_of_a_large_rank_one_matrix_is_a_number_in_float32(seed):
    v = 3e3 * np.random.default_rng(seed).normal(size=2)
    computed = linalg.log_det_1p(jnp.asarray(np.outer(v, v), dtype=jnp.float32))
    # Only the rounding of the determinant may be added, up to eps of the product of two entries.
    low = np.log1p(v @ v)
    slack = 4 * eps(np.float32) * np.max(v**2) ** 2
    assert low - 1e-5 <= computed <= np.log1p(v @ v + slack) + 1e-5


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("scale", [1e-30, 1e-9, 1e-4, 1e-2, 1.0, 1e3])
def test_log_det_1p_is_accurate_in_float32_for_small_and_large(n, scale, rng):
    M = (scale * random_spd(rng, n)).astype(np.float32)
    expected = np.sum(np.log1p(np.linalg.eigvalsh(M.astype(np.float64))))
    np.testing.assert_allclose(
        linalg.log_det_1p(jnp.asarray(M)), expected, rtol=4 * n * eps(np.float32)
    )


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_log_det_spd_under_any_units(n, scale, x64, rng):
    units = scale * 10 ** rng.uniform(-3, 3, n)
    M = random_spd(rng, n) * np.outer(units, units)
    np.testing.assert_allclose(
        linalg.log_det_spd(jnp.asarray(M)), np.linalg.slogdet(M)[1], rtol=1e-12, atol=1e-12
    )


def test_log_det_of_i_plus_m_itself_would_lose_the_small():
    M = np.float32(1e-9) * np.eye(2, dtype=np.float32)
    assert np.linalg.slogdet(np.eye(2, dtype=np.float32) + M)[1] == 0
    assert linalg.log_det_1p(jnp.asarray(M)) == pytest.approx(2e-9)


def test_symmetrise_takes_the_symmetric_part_of_a_batch(rng):
    M = rng.normal(size=(5, 3, 3))
    np.testing.assert_allclose(linalg.symmetrise(M), (M + M.transpose(0, 2, 1)) / 2)


@pytest.mark.parametrize("n", [1, 2, 5])
@pytest.mark.parametrize("diagonal", [True, False])
def test_forms_and_products_by_components_match_numpy(n, diagonal, x64, rng):
    weight = rng.uniform(0.5, 2, n) if diagonal else random_spd(rng, n)
    M = np.diag(weight) if diagonal else weight
    x, reference = rng.normal(size=(2, n))
    # a vector may come whole or by components
    for form in (jnp.asarray(x), list(x)):
        np.testing.assert_allclose(linalg.quadratic_form(weight, form), x @ M @ x, rtol=1e-13)
        np.testing.assert_allclose(
            jnp.stack(linalg.matvec(weight, form)), M @ x, rtol=1e-12, atol=1e-14
        )
        np.testing.assert_allclose(linalg.dot(reference, form), reference @ x, rtol=1e-12)
        np.testing.assert_allclose(
            jnp.stack(linalg.minus(form, reference)), x - reference, rtol=1e-14
        )
    np.testing.assert_array_equal(linalg.as_matrix(weight), M)


def test_apply_takes_rectangular_matrices_and_minus_stops_at_the_reference(x64, rng):
    M = rng.normal(size=(4, 3))
    x = rng.normal(size=3)
    np.testing.assert_allclose(jnp.stack(linalg.matvec(M, x)), M @ x, rtol=1e-12)
    np.testing.assert_allclose(
        jnp.stack(linalg.minus(x, np.array([1.0, 2.0]))), x[:2] - [1, 2], rtol=1e-14
    )


def test_batches_by_vmap_keep_the_sample_as_last_axis(x64, rng):
    M = random_spd(rng, 3)
    x = rng.normal(size=(3, 7))
    computed = jax.vmap(lambda v: linalg.quadratic_form(M, v), in_axes=-1)(x)
    np.testing.assert_allclose(computed, np.einsum("in,ij,jn->n", x, M, x), rtol=1e-13)


@precision
@pytest.mark.parametrize("n", [1, 2, 3])
@settings(max_examples=60, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), exponent=st.integers(-24, 24))
def test_largest_eigenvalue_and_deviation_at_any_scale(n, precision, seed, exponent):
    context, dtype = PRECISIONS[precision]
    rng = np.random.default_rng(seed)
    M = random_spd(rng, n, 0.01, 2.0) * 10.0**exponent
    with context():
        M = np.tril(M).astype(dtype) + np.tril(M, -1).T.astype(dtype)
        computed = [np.asarray(f(M)) for f in (largest_eigenvalue, largest_deviation)]
    expected = np.linalg.eigvalsh(M.astype(np.float64))[-1]
    np.testing.assert_allclose(computed[0], expected, rtol=8 * eps(dtype))
    np.testing.assert_allclose(computed[1], np.sqrt(expected), rtol=8 * eps(dtype))


def test_gradient_of_the_largest_eigenvalue_is_that_of_its_eigenvector(x64, rng):
    M = random_spd(rng, 2, 0.1, 2.0)
    v = np.linalg.eigh(M)[1][:, -1]
    gradient = np.asarray(jax.grad(linalg.largest_eigenvalue)(M))
    # Only the upper of the two entries off the diagonal is read.
    np.testing.assert_allclose(gradient, [[v[0] ** 2, 2 * v[0] * v[1]], [0, v[1] ** 2]], rtol=1e-12)


@pytest.mark.parametrize("variance", [1.0, 1e-30])
def test_gradient_is_finite_where_both_eigenvalues_are_equal(variance):
    M = variance * jnp.eye(2)
    np.testing.assert_array_equal(jax.grad(linalg.largest_eigenvalue)(M), np.eye(2) / 2)
    deviation, gradient = jax.value_and_grad(linalg.largest_deviation)(M)
    np.testing.assert_allclose(deviation, np.sqrt(variance), rtol=1e-6)
    np.testing.assert_allclose(gradient, np.eye(2) / 4 / np.sqrt(variance), rtol=1e-6)


def test_what_is_certain_has_no_deviation_and_no_gradient():
    deviation, gradient = jax.value_and_grad(linalg.largest_deviation)(jnp.zeros((2, 2)))
    assert deviation == 0
    np.testing.assert_array_equal(gradient, np.zeros((2, 2)))
    rounded_below_zero = jnp.array([[-1e-12]])
    assert linalg.largest_deviation(rounded_below_zero) == 0


def test_a_covariance_that_is_no_number_has_no_deviation():
    assert np.isnan(largest_deviation(jnp.full((2, 2), jnp.nan)))
