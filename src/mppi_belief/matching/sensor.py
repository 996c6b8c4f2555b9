"""Exact matching (15) by the choice of what is sensed (after Das and Tanaka 2026, arXiv 2604.18941).

    Sigma C' R_o^-1 C Sigma = lambda G R^-1 G'     if     C = sigma_o O T' G' Sigma^-1,   T T' = lambda R^-1    (a)

for every O (ny, nu) with O'O = I. A measurement every dt moves the mean by K S K' = D dt, S = C Sigma C' + R_o / dt for
the predicted covariance Sigma; there D = lambda G R^-1 G' exactly, for

    C = sigma_o O (I - W dt)^(-1/2) T' G' Sigma^-1,    W = T' G' Sigma^-1 G T                                    (b)

which exists as long as Sigma > lambda G R^-1 G' dt: what matching takes from the covariance has to be there. Either way
the covariance no longer depends on the sensor, dSigma = A Sigma + Sigma A' + Q - lambda G R^-1 G'.

Limited is the signal-to-noise ratio of the sensor, the singular values of sigma_o^-1 C: values above the limit are set
to it, which is the nearest sensor that is allowed, and leaves the same D for every O. As the limit grows, D grows
towards the matched one in the order of matrices, so that the residual of (15) never rises.
"""

import jax.numpy as jnp
from jax import Array

LEFT = 1e-4  # part of a variance that a measurement leaves at least; chosen: single precision resolves the rest


def matching_sensor(
    root: Array,
    G: Array,
    R: Array,
    temperature: Array | float,
    noise: Array,
    dt: Array | float = 0.0,
    limit: Array | float | None = None,
) -> Array:
    """C (ny, nx) of (b), O the first columns of I, for a covariance root root' (nx, nx), G (nx, nu) and R (nu, nu).

    `noise` (ny, ny) is a factor of the intensity R_o; dt = 0 is (a). `limit` bounds the singular values of noise^-1 C,
    whose unit is 1 / (that of the state times the root of time).

    Where the covariance is used up, what is left of it is measured down to a part `LEFT`; where there is none,
    nothing is. Raises ValueError for fewer measurements than controls.
    """
    nu, ny = G.shape[1], noise.shape[0]
    if ny < nu:
        raise ValueError(
            f"a sensor that makes matching hold measures as much as there are controls: {ny} < {nu}"
        )
    T = jnp.linalg.cholesky(temperature * jnp.linalg.inv(R))
    inverse = jnp.linalg.pinv(root)
    reach = inverse @ G @ T  # the diffusion that is wanted, in units of the covariance
    values, vectors = jnp.linalg.eigh(reach.T @ reach)
    stretch = 1.0 / jnp.sqrt(jnp.maximum(1.0 - values * dt, LEFT * values * dt))
    ratio = (vectors * stretch) @ vectors.T @ reach.T @ inverse
    return noise[:, :nu] @ (ratio if limit is None else _clipped(ratio, limit))


def _clipped(M: Array, limit: Array | float) -> Array:
    """The nearest matrix to M (m, n) in the Frobenius norm with no singular value above `limit`."""
    squares, vectors = jnp.linalg.eigh(M @ M.T)
    kept = limit / jnp.sqrt(jnp.maximum(squares, limit**2))
    return (vectors * kept) @ vectors.T @ M
