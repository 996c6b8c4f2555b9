"""Gaussian expectations by a cubature rule of degree 5, for costs without closed form.

McNamee and Stenger (1967), in the form of Lu and Darmofal (2004): 2 n^2 + 1 points, exact for
polynomials of degree 5, hence for the mean *and the variance* of any quadratic, which the usual
2n-point rules get wrong. Weights are non-negative up to n = 4; beyond, variances are kept >= 0.
"""

from collections.abc import Callable
from functools import cache
from itertools import combinations

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.stats import qmc

from .linalg import psd_factor


def rule(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (2 n^2 + 1, n) and weights (2 n^2 + 1,) for N(0, I_n)."""
    axes = np.sqrt(n + 2.0) * np.eye(n)
    pairs = [
        np.sqrt((n + 2.0) / 2) * (np.eye(n)[i] + sign * np.eye(n)[j])
        for i, j in combinations(range(n), 2)
        for sign in (1, -1)
    ]
    half = np.vstack([axes, *pairs])
    weights = np.concatenate(
        [np.full(n, (4 - n) / (2 * (n + 2) ** 2)), np.full(len(pairs), 1 / (n + 2) ** 2)]
    )
    points = np.vstack([np.zeros((1, n)), half, -half])
    return points, np.concatenate([[2 / (n + 2)], weights, weights])


def evaluate(fn: Callable[[Array], Array], mean: Array, cov: Array) -> tuple[Array, Array]:
    """Values (P,) of a scalar `fn` at the rule's points for N(mean, cov), and the weights (P,)."""
    points, weights = rule(mean.shape[0])
    factor, _ = psd_factor(cov)
    offsets = jnp.asarray(points, dtype=cov.dtype) @ factor.T
    return jax.vmap(lambda offset: fn(mean + offset))(offsets), jnp.asarray(
        weights, dtype=cov.dtype
    )


def expectation(fn: Callable[[Array], Array], mean: Array, cov: Array) -> Array:
    """E[fn(x)] () for scalar `fn`."""
    values, weights = evaluate(fn, mean, cov)
    return jnp.sum(weights * values)


MOST_NODES, MOST_PER_AXIS, TENSOR_UP_TO = 100_000, 64, 6


SOBOL = 2**14


@cache
def gaussian_nodes(nx: int, per_axis: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Points (P, nx) and weights (P,), which sum to 1, for N(0, I).

    The tensor product of the Gauss-Hermite rule with `per_axis` points, by default as many as keep P within 1e5
    but at most 64; without `per_axis` and for nx > 6, a scrambled Sobol sequence with equal weights, always the same.
    """
    if per_axis is None and nx > TENSOR_UP_TO:
        points = qmc.MultivariateNormalQMC(np.zeros(nx), inv_transform=True, seed=0).random(SOBOL)
        return points, np.full(SOBOL, 1 / SOBOL)
    per_axis = per_axis or min(MOST_PER_AXIS, int(MOST_NODES ** (1 / nx)))
    abscissae, line = np.polynomial.hermite_e.hermegauss(per_axis)
    points = np.stack(np.meshgrid(*[abscissae] * nx, indexing="ij"), axis=-1).reshape(-1, nx)
    weights = (
        np.stack(np.meshgrid(*[line / line.sum()] * nx, indexing="ij"), axis=-1)
        .prod(axis=-1)
        .ravel()
    )
    return points, weights
