"""Exact matching (15) by the choice of the sensor (after Das and Tanaka 2026, arXiv 2604.18941).

    Sigma C' R_o^-1 C Sigma = lambda G R^-1 G'   if   C = sigma_o O T' G' Sigma^-1           (a)

with T T' = lambda R^-1, for every O (ny, nu) with O'O = I. A measurement every dt moves the mean by
K S K' = D dt, S = C Sigma C' + R_o / dt for the predicted covariance Sigma; there
D = lambda G R^-1 G' exactly, for

    C = sigma_o O (I - W dt)^(-1/2) T' G' Sigma^-1,    W = T' G' Sigma^-1 G T                (b)

which exists as long as Sigma > lambda G R^-1 G' dt: the covariance must hold what matching takes
from it. Either way the covariance no longer depends on the sensor,
dSigma = A Sigma + Sigma A' + Q - lambda G R^-1 G'.

The sensor's signal-to-noise ratio, the singular values of sigma_o^-1 C, may be limited. Values
above the limit are set to it, which gives the nearest sensor allowed and leaves D the same for
every O. As the limit grows, D grows towards the matched one in the order of matrices, so the
residual of (15) never rises.
"""

import jax.numpy as jnp
from jax import Array

# Part of a variance that a measurement leaves at least; chosen: single precision resolves the rest.
LEAST_REMAINING = 1e-4


def matching_sensor(
    root: Array,
    G: Array,
    R: Array,
    temperature: Array | float,
    noise: Array,
    dt: Array | float = 0.0,
    limit: Array | float | None = None,
) -> Array:
    """Returns C (ny, nx) of (b), O the first columns of I, for a covariance root root' (nx, nx).

    G is (nx, nu), R is (nu, nu), and `noise` (ny, ny) is a factor of the intensity R_o; dt = 0 is
    (a). `limit` bounds the singular values of noise^-1 C, whose unit is 1 / (that of the state
    times the root of time).

    Where the covariance is used up, its rest is measured down to a part `LEAST_REMAINING`; where
    there is none, nothing is measured. Raises ValueError for fewer measurements than controls.
    """
    nu = G.shape[1]
    ny = noise.shape[0]
    if ny < nu:
        raise ValueError(
            f"a sensor that makes matching hold measures as much as there are controls: {ny} < {nu}"
        )
    # The diffusion that is wanted, in units of the covariance.
    T = jnp.linalg.cholesky(temperature * jnp.linalg.inv(R))
    inverse = jnp.linalg.pinv(root)
    wanted = inverse @ G @ T

    # (I - W dt)^(-1/2) T' G' Sigma^-1, with W = wanted' wanted.
    values, vectors = jnp.linalg.eigh(wanted.T @ wanted)
    remaining = jnp.maximum(1.0 - values * dt, LEAST_REMAINING * values * dt)
    ratio = (vectors * (1.0 / jnp.sqrt(remaining))) @ vectors.T @ wanted.T @ inverse
    return noise[:, :nu] @ (ratio if limit is None else _clip_singular_values(ratio, limit))


def _clip_singular_values(M: Array, limit: Array | float) -> Array:
    """Returns the matrix nearest to M (m, n) (Frobenius norm) with limited singular values."""
    squares, vectors = jnp.linalg.eigh(M @ M.T)
    factors = limit / jnp.sqrt(jnp.maximum(squares, limit**2))
    return (vectors * factors) @ vectors.T @ M
