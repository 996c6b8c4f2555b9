"""How far the belief's diffusion is from the tangent space of Gaussian means (Theorem 1).

    c(x) - E c = A(mu) (x - mu)   for all mu                                              (7)

A measurement changes the density pi of the belief N(mu, Sigma) in the directions pi (c - E c); a
change of its mean is in the directions pi Sigma^-1 (x - mu). The part of the former outside the
latter, in the mean square under pi, is

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
    """Returns the part () of c outside the mean tangent space at N(mean, cov), and A (ny, nx).

    A is the best fit. For c: (nx,) -> (ny,), mean (nx,), cov (nx, nx) positive definite;
    expectations are taken by `nodes`, by default `gaussian_nodes(nx)`. The fit is least squares on
    the nodes themselves: an affine c leaves nothing but rounding, whatever the nodes. A c that is
    constant to rounding has part 0. The components of c count by their units: divide by sigma_o to
    compare them.
    """
    points, weights = (
        jnp.asarray(part, dtype=cov.dtype) for part in nodes or gaussian_nodes(mean.shape[0])
    )
    factor = jnp.linalg.cholesky(cov)
    values = jax.vmap(lambda z: c(mean + factor @ z))(points)

    # Weighted least squares for the slope (nx, ny) of c in z.
    z = points - weights @ points
    centred = values - weights @ values
    weighted = weights[:, None] * z
    slope = jnp.linalg.solve(weighted.T @ z, weighted.T @ centred)

    # The part that the fit leaves; zero where c does not vary beyond rounding.
    residual_power = weights @ jnp.sum((centred - z @ slope) ** 2, axis=1)
    power = weights @ jnp.sum(centred**2, axis=1)
    rounding = len(weights) * jnp.finfo(cov.dtype).eps * jnp.max(jnp.abs(weights @ values))
    ratio = residual_power / jnp.where(power > 0, power, 1.0)
    part = jnp.where(power > rounding**2, ratio, 0.0)
    return part, jax.scipy.linalg.solve_triangular(factor.T, slope, lower=False).T
