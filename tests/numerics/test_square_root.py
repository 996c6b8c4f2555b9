"""Square-root algebra against NumPy: ranks, triangular roots, LDL, distances and densities."""

from contextlib import nullcontext

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from helpers import float64, quick_jit, random_spd
from mppi_belief.numerics import square_root

PRECISIONS = {"float32": (nullcontext, np.float32), "float64": (float64, np.float64)}
factorise = quick_jit(square_root.psd_factor)
precision = pytest.mark.parametrize("precision", PRECISIONS)


def eps(dtype: type) -> float:
    return float(np.finfo(dtype).eps)


@precision
@pytest.mark.parametrize(("n", "rank"), [(n, r) for n in (1, 2, 4) for r in range(n + 1)])
def test_psd_factor_has_the_rank_of_the_matrix(n, rank, precision, rng):
    context, dtype = PRECISIONS[precision]
    for scale in (1e-6, 1.0, 1e6):
        basis, _ = np.linalg.qr(rng.normal(size=(n, n)))
        values = np.append(rng.uniform(0.1, 1, rank), np.zeros(n - rank))
        M = (scale * basis @ np.diag(values) @ basis.T).astype(dtype)
        with context():
            L, computed = (np.asarray(part) for part in factorise(M))
        assert computed == rank == np.linalg.matrix_rank(M, hermitian=True)
        np.testing.assert_array_equal(L[:, rank:], 0)
        assert np.all(np.any(L[:, :rank] != 0, axis=0))
        np.testing.assert_allclose(L @ L.T, M, atol=20 * n * eps(dtype) * scale)


def test_psd_factor_of_zero_is_zero_of_rank_zero():
    L, rank = factorise(jnp.zeros((3, 3)))
    assert rank == 0
    np.testing.assert_array_equal(L, 0)


@pytest.mark.parametrize(("n", "m"), [(1, 1), (2, 5), (4, 4)])
def test_tria_is_lower_triangular_with_the_same_product(n, m, x64, rng):
    M = rng.normal(size=(n, m))
    L = np.asarray(quick_jit(square_root.tria)(M))
    np.testing.assert_array_equal(L, np.tril(L))
    np.testing.assert_allclose(L @ L.T, M @ M.T, atol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 4])
def test_ldl_solve_makes_correlated_noise_independent(n, x64, rng):
    R = random_spd(rng, n)
    T, variances = quick_jit(square_root.ldl_solve)(jnp.eye(n), R)
    np.testing.assert_array_equal(T, np.tril(T))
    np.testing.assert_array_equal(np.diag(T), 1)
    np.testing.assert_allclose(T @ R @ T.T, np.diag(np.stack(variances)), atol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 4])
def test_distance_and_density_are_those_of_a_normal_distribution(n, x64, rng):
    M = random_spd(rng, n)
    x = rng.normal(size=n)
    squared = x @ np.linalg.solve(M, x)
    density = stats.multivariate_normal(cov=M).logpdf(x) + 0.5 * n * np.log(2 * np.pi)
    np.testing.assert_allclose(square_root.mahalanobis_squared(x, M), squared, rtol=1e-11)
    np.testing.assert_allclose(square_root.log_normal_density(x, M), density, rtol=1e-11)


def test_the_potter_update_is_the_textbooks(x64, rng):
    root = rng.normal(size=(3, 3))
    C = rng.normal(size=(2, 3))
    R_s = random_spd(rng, 2)
    update = quick_jit(square_root.potter_update)(root, C, R_s)
    cov = root @ root.T
    S = C @ cov @ C.T + R_s
    K = cov @ C.T @ np.linalg.inv(S)
    np.testing.assert_allclose(update.gain, K, rtol=1e-10)
    np.testing.assert_allclose(update.root @ update.root.T, cov - K @ S @ K.T, atol=1e-12)
    np.testing.assert_allclose(update.mean_factor @ update.mean_factor.T, K @ S @ K.T, atol=1e-12)
