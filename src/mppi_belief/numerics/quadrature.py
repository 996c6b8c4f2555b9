"""Expectations under Gaussians: the cubature rules of planner and filter, and fine grids of nodes.

| rule | nodes | exact to degree | weights | used by |
|---|---|---|---|---|
| `degree_five_rule` | 2 n^2 + 1 | 5 | negative from n = 5 on | costs without closed form |
| `sigma_points` | up to 2 n^2 + 1 | 5, beyond n = 4: 3 | none negative | unscented filter |
| `gaussian_nodes` | up to 1e5 | high | none negative | Theorem 1's residual |

The rule of degree 5 is that of McNamee and Stenger (1967) in the form of Lu and Darmofal (2004). It
gives the mean *and the variance* of any quadratic, which the usual 2n-point rules get wrong.
"""

from collections.abc import Callable
from functools import cache
from itertools import combinations

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.stats import qmc

from .square_root import psd_factor

MOST_STATES_OF_DEGREE_FIVE = 4  # up to which the rule of degree 5 has no negative weight
MOST_TENSOR_NODES = 100_000  # of a tensor product of Gauss-Hermite rules
MOST_NODES_PER_AXIS = 64
MOST_TENSOR_STATES = 6  # beyond, a Sobol sequence takes the place of the tensor product
SOBOL_NODES = 2**14


def degree_five_rule(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns points (2 n^2 + 1, n) and weights (2 n^2 + 1,) for N(0, I_n), exact to degree 5."""
    axes = np.sqrt(n + 2.0) * np.eye(n)
    diagonals = []
    for i, j in combinations(range(n), 2):
        for sign in (1, -1):
            diagonals.append(np.sqrt((n + 2.0) / 2) * (np.eye(n)[i] + sign * np.eye(n)[j]))
    half = np.vstack([axes, *diagonals])
    axis_weights = np.full(n, (4 - n) / (2 * (n + 2) ** 2))
    diagonal_weights = np.full(len(diagonals), 1 / (n + 2) ** 2)
    half_weights = np.concatenate([axis_weights, diagonal_weights])
    points = np.vstack([np.zeros((1, n)), half, -half])
    return points, np.concatenate([[2 / (n + 2)], half_weights, half_weights])


def sigma_points(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns points (P, n) and positive weights (P,) for N(0, I_n).

    Up to 4 states they are those of the rule of degree 5, without the points of weight zero. With
    more states, where some weights of this rule are negative, they are the 2 n points of degree 3
    (Arasaratnam and Haykin 2009).
    """
    if n > MOST_STATES_OF_DEGREE_FIVE:
        return np.sqrt(n) * np.vstack([np.eye(n), -np.eye(n)]), np.full(2 * n, 0.5 / n)
    points, weights = degree_five_rule(n)
    return points[weights > 0], weights[weights > 0]


def evaluate_at_nodes(fn: Callable[[Array], Array], mean: Array, cov: Array) -> tuple[Array, Array]:
    """Returns a scalar `fn` (P,) at the nodes of degree 5 for N(mean, cov), and weights (P,)."""
    points, weights = degree_five_rule(mean.shape[0])
    factor, _ = psd_factor(cov)
    offsets = jnp.asarray(points, dtype=cov.dtype) @ factor.T
    values = jax.vmap(lambda offset: fn(mean + offset))(offsets)
    return values, jnp.asarray(weights, dtype=cov.dtype)


def expectation(fn: Callable[[Array], Array], mean: Array, cov: Array) -> Array:
    """Returns E[fn(x)] () for a scalar `fn`, by the rule of degree 5."""
    values, weights = evaluate_at_nodes(fn, mean, cov)
    return jnp.sum(weights * values)


@cache
def gaussian_nodes(nx: int, per_axis: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Returns points (P, nx) and weights (P,), which sum to 1, for N(0, I).

    The nodes are the tensor product of the Gauss-Hermite rule with `per_axis` points, by default as
    many as keep P within 1e5 but at most 64. Without `per_axis` and for nx > 6 they are a scrambled
    Sobol sequence with equal weights, always the same.
    """
    if per_axis is None and nx > MOST_TENSOR_STATES:
        sequence = qmc.MultivariateNormalQMC(np.zeros(nx), inv_transform=True, seed=0)
        return sequence.random(SOBOL_NODES), np.full(SOBOL_NODES, 1 / SOBOL_NODES)
    per_axis = per_axis or min(MOST_NODES_PER_AXIS, int(MOST_TENSOR_NODES ** (1 / nx)))
    abscissae, axis_weights = np.polynomial.hermite_e.hermegauss(per_axis)
    axis_weights = axis_weights / axis_weights.sum()
    points = np.stack(np.meshgrid(*[abscissae] * nx, indexing="ij"), axis=-1).reshape(-1, nx)
    factors = np.stack(np.meshgrid(*[axis_weights] * nx, indexing="ij"), axis=-1)
    return points, factors.prod(axis=-1).ravel()
