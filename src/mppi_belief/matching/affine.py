"""How far the belief's diffusion is from the tangent space of Gaussian means (Theorem 1).

    c(x) - E c = A(mu) (x - mu)   for all mu                                              (7)

What a measurement does to the belief N(mu, Sigma) is in the direction pi (c - E c), what moving its mean does in
pi Sigma^-1 (x - mu). The part of the former outside the latter, in the mean square under pi, is

    min_A E|c - E c - A (x - mu)|^2 / E|c - E c|^2

which is zero for all mu if and only if c is affine. The minimum is at A = E[dc/dx] (Stein).
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..numerics.quadrature import gaussian_nodes


def outside_mean_tangent(
    c: Callable[[Array], Array],
    mean: Array,
    cov: Array,
    nodes: tuple[Array | np.ndarray, Array | np.ndarray] | None = None,
) -> tuple[Array, Array]:
    """The part () of c: (nx,) -> (ny,) outside the mean tangent space at N(mean, cov), and the best A (ny, nx).

    For mean (nx,), cov (nx, nx) positive definite; expectations by `nodes`, by default `gaussian_nodes(nx)`.
    Least squares on the nodes themselves: an affine c leaves nothing but rounding, whatever the nodes. A c that
    is constant to rounding has part 0. The components of c count by their units: divide by sigma_o to compare them.
    """
    points, weights = (
        jnp.asarray(part, dtype=cov.dtype) for part in nodes or gaussian_nodes(mean.shape[0])
    )
    factor = jnp.linalg.cholesky(cov)
    values = jax.vmap(lambda z: c(mean + factor @ z))(points)
    z, centred = points - weights @ points, values - weights @ values
    weighted = weights[:, None] * z
    slope = jnp.linalg.solve(weighted.T @ z, weighted.T @ centred)  # (nx, ny), for z
    left, whole = (weights @ jnp.sum(part**2, axis=1) for part in (centred - z @ slope, centred))
    noise = len(weights) * jnp.finfo(cov.dtype).eps * jnp.max(jnp.abs(weights @ values))
    part = jnp.where(whole > noise**2, left / jnp.where(whole > 0, whole, 1.0), 0.0)
    return part, jax.scipy.linalg.solve_triangular(factor.T, slope, lower=False).T
