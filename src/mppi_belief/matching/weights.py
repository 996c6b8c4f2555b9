"""The matching condition (15): its residual, and the weights that meet it (Sec. V-B, Prop. 3).

    D = lambda G R^-1 G' = G W G',      epsilon(W) = |D - G W G'|_F / |D|_F

D is the diffusion of the belief mean (9). epsilon is least at W* = G^+ D G^+', which is positive
semidefinite because D is; what remains is the part of D outside the range of G, which no control
reaches.

    (i)  some W >= 0 has D = lambda G W G'     if and only if  range(D) is contained in range(G)
    (ii) some R > 0 has D = lambda G R^-1 G'   if and only if  range(D) = range(G)

Ranks, and with them ranges, are numerical: singular values count above max(shape) eps times the
largest. One W for a whole schedule is in `constant_weight`.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

Matrix = Array | np.ndarray


def matched_weight(R: Array, temperature: Array | float) -> Array:
    """Returns W = lambda R^-1 (nu, nu) of (15), for R (nu, nu)."""
    return temperature * jnp.linalg.inv(R)


def best_weight(D: Array, G: Array) -> Array:
    """Returns W* (nu, nu), for which G W G' is nearest to D (nx, nx) in the Frobenius norm.

    G is (nx, nu).
    """
    inverse = jnp.linalg.pinv(G, rtol=rank_cutoff(max(G.shape), jnp.result_type(G, jnp.float32)))
    return inverse @ D @ inverse.T


def residual(D: Array, G: Array, W: Array) -> Array:
    """Returns epsilon(W) (), not finite for D = 0."""
    return jnp.sqrt(jnp.sum((D - G @ W @ G.T) ** 2) / jnp.sum(D**2))


def numerical_rank(M: Matrix) -> int:
    """Counts the singular values of M (m, n) above max(m, n) eps times the largest."""
    values = np.linalg.svd(_floats(M)[0], compute_uv=False)
    return int(np.sum(values > rank_cutoff(max(np.shape(M)), values.dtype) * values[0]))


def range_included(D: Matrix, G: Matrix) -> bool:
    """Returns whether range(D) is contained in range(G), for D (nx, nx) and G (nx, nu).

    It is where the columns of D, scaled to the norm of G, do not raise the numerical rank of G, in
    the coarser precision of the two.
    """
    D, G = _floats(D, G)
    norm_D = np.linalg.norm(D)
    norm_G = np.linalg.norm(G)
    if not (norm_D and norm_G):
        return not norm_D
    return numerical_rank(np.hstack([D / norm_D, G / norm_G])) <= numerical_rank(G)


def feasible_weight(D: Matrix, G: Matrix, temperature: float) -> np.ndarray:
    """Returns W >= 0 (nu, nu) with D = lambda G W G' (Proposition 3(i)).

    From D^1/2 = G M it is W = M M' / lambda. Raises ValueError if range(D) is not contained in
    range(G).
    """
    if not range_included(D, G):
        raise ValueError("no W >= 0 gives D = lambda G W G': range(D) is not contained in range(G)")
    D, G = _floats(D, G)
    values, vectors = np.linalg.eigh(D)
    square_root = vectors * np.sqrt(np.maximum(values, 0))
    M = np.linalg.pinv(G, rcond=rank_cutoff(max(G.shape), G.dtype)) @ square_root
    return M @ M.T / temperature


def feasible_control_weight(D: Matrix, G: Matrix, temperature: float) -> np.ndarray:
    """Returns R > 0 (nu, nu) with D = lambda G R^-1 G', for range(D) = range(G) (Prop. 3(ii)).

    R^-1 is solved for on the row space of G; on ker G, where D says nothing of it, it is the
    geometric mean of its other eigenvalues (1 if there are none). Raises ValueError if the ranges
    differ, or if R is too badly conditioned for the precision of D and G.
    """
    D, G = _floats(D, G)
    rank_D = numerical_rank(D)
    rank_G = numerical_rank(G)
    if not range_included(D, G):
        raise ValueError(
            "no R > 0 gives D = lambda G R^-1 G': range(D) is not contained in range(G)"
        )
    if rank_D != rank_G:
        raise ValueError(
            f"no R > 0 gives D = lambda G R^-1 G': rank(D) = {rank_D} < rank(G) = {rank_G}"
        )
    U, s, Vt = np.linalg.svd(G)
    reached = U[:, :rank_G] / s[:rank_G]
    values, vectors = np.linalg.eigh(reached.T @ D @ reached / temperature)
    if np.any(values <= 0):
        raise ValueError(
            "R > 0 with D = lambda G R^-1 G' is too badly conditioned for this precision"
        )
    rows = Vt[:rank_G].T @ vectors
    kernel = Vt[rank_G:].T
    kernel_weight = np.exp(-np.mean(np.log(values))) if rank_G else 1.0
    return (rows / values) @ rows.T + kernel_weight * kernel @ kernel.T


def _floats(*matrices: Matrix) -> list[np.ndarray]:
    """Returns NumPy arrays in the coarsest floating point precision among them."""
    arrays = [np.asarray(M) for M in matrices]
    coarsest = max(
        (np.result_type(M, np.float32) for M in arrays), key=lambda dtype: np.finfo(dtype).eps
    )
    return [M.astype(coarsest) for M in arrays]


def rank_cutoff(longest: int, dtype: Any) -> float:
    """Returns max(shape) eps, for the larger of the two sizes."""
    return longest * float(jnp.finfo(dtype).eps)
