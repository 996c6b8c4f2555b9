"""The matching condition (15) and how far it is from holding (Sec. V-B, Proposition 3).

    D = lambda G R^-1 G' = G W G',      epsilon(W) = |D - G W G'|_F / |D|_F

D is the diffusion of the belief mean (9). epsilon is least at W* = G^+ D G^+', which is positive
semidefinite because D is; what is left is the part of D outside the range of G, which no control reaches.
"""

import jax.numpy as jnp
from jax import Array


def matched_weight(R: Array, temperature: Array | float) -> Array:
    """W = lambda R^-1 (nu, nu) of (15), for R (nu, nu)."""
    return temperature * jnp.linalg.inv(R)


def best_weight(D: Array, G: Array) -> Array:
    """W* (nu, nu) that brings G W G' nearest to D (nx, nx) in the Frobenius norm, for G (nx, nu)."""
    inverse = jnp.linalg.pinv(G)
    return inverse @ D @ inverse.T


def residual(D: Array, G: Array, W: Array) -> Array:
    """epsilon(W) (), not finite for D = 0."""
    return jnp.sqrt(jnp.sum((D - G @ W @ G.T) ** 2) / jnp.sum(D**2))
