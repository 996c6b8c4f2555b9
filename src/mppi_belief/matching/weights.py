"""The matching condition (15): how far it is from holding, when a weight meets it (Sec. V-B, Proposition 3).

    D = lambda G R^-1 G' = G W G',      epsilon(W) = |D - G W G'|_F / |D|_F

D is the diffusion of the belief mean (9). epsilon is least at W* = G^+ D G^+', which is positive
semidefinite because D is; what is left is the part of D outside the range of G, which no control reaches.

    (i)  some W >= 0 has D = lambda G W G'     if and only if  range(D) is contained in range(G)
    (ii) some R > 0 has D = lambda G R^-1 G'   if and only if  range(D) = range(G)

Ranks, and with them ranges, are numerical: singular values count above max(shape) eps times the largest.
One W for a whole schedule, the minimum over W >= 0 of sum_k |D_k - G_k W G_k'|^2 / |D_k|^2, is a convex problem.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

Matrix = Array | np.ndarray


def matched_weight(R: Array, temperature: Array | float) -> Array:
    """W = lambda R^-1 (nu, nu) of (15), for R (nu, nu)."""
    return temperature * jnp.linalg.inv(R)


def best_weight(D: Array, G: Array) -> Array:
    """W* (nu, nu) that brings G W G' nearest to D (nx, nx) in the Frobenius norm, for G (nx, nu)."""
    inverse = jnp.linalg.pinv(G, rtol=_cutoff(max(G.shape), jnp.result_type(G, jnp.float32)))
    return inverse @ D @ inverse.T


def residual(D: Array, G: Array, W: Array) -> Array:
    """epsilon(W) (), not finite for D = 0."""
    return jnp.sqrt(jnp.sum((D - G @ W @ G.T) ** 2) / jnp.sum(D**2))


def numerical_rank(M: Matrix) -> int:
    """How many singular values of M (m, n) lie above max(m, n) eps times the largest."""
    values = np.linalg.svd(_floats(M)[0], compute_uv=False)
    return int(np.sum(values > _cutoff(max(np.shape(M)), values.dtype) * values[0]))


def range_included(D: Matrix, G: Matrix) -> bool:
    """Whether range(D) is contained in range(G), D (nx, nx) and G (nx, nu): columns of D, scaled to the norm of G,
    do not raise its numerical rank. In the coarser precision of the two."""
    D, G = _floats(D, G)
    sizes = [np.linalg.norm(M) for M in (D, G)]
    if not all(sizes):
        return not sizes[0]
    both = np.hstack([M / size for M, size in zip((D, G), sizes, strict=True)])
    return numerical_rank(both) <= numerical_rank(G)


def feasible_weight(D: Matrix, G: Matrix, temperature: float) -> np.ndarray:
    """Proposition 3(i): W >= 0 (nu, nu) with D = lambda G W G', from D^1/2 = G M as W = M M' / lambda.

    Raises ValueError if range(D) is not contained in range(G).
    """
    if not range_included(D, G):
        raise ValueError("no W >= 0 gives D = lambda G W G': range(D) is not contained in range(G)")
    D, G = _floats(D, G)
    values, vectors = np.linalg.eigh(D)
    M = np.linalg.pinv(G, rcond=_cutoff(max(G.shape), G.dtype)) @ (
        vectors * np.sqrt(np.maximum(values, 0))
    )
    return M @ M.T / temperature


def feasible_control_weight(D: Matrix, G: Matrix, temperature: float) -> np.ndarray:
    """Proposition 3(ii): R > 0 (nu, nu) with D = lambda G R^-1 G', for range(D) = range(G).

    R^-1 is solved for on the row space of G; on ker G, where D says nothing of it, it is the geometric mean of its
    other eigenvalues (1 if there are none). Raises ValueError if the ranges differ, or if R is too badly conditioned
    for the precision of D and G.
    """
    D, G = _floats(D, G)
    rank_D, rank_G = numerical_rank(D), numerical_rank(G)
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
    rows, kernel = Vt[:rank_G].T @ vectors, Vt[rank_G:].T
    elsewhere = np.exp(-np.mean(np.log(values))) if rank_G else 1.0
    return (rows / values) @ rows.T + elsewhere * kernel @ kernel.T


class ConstantWeight(NamedTuple):
    """One W for a schedule: `weight` (nu, nu), `value` () = sum_k epsilon_k(W)^2 over the `steps` with D_k != 0,
    and `gap` (), by at most which any other W >= 0 has a smaller sum."""

    weight: np.ndarray
    value: float
    steps: int
    gap: float


class _Quadratic(NamedTuple):
    """sum_k |D_k - G_k W G_k'|^2 / |D_k|^2 = sum_k |E_k - F_k Z F_k'|^2, Z = root W root, sum_k F_k' F_k a projector.

    `hessian` maps vec(Z) to vec(sum F'F Z F'F), `steepest` its largest eigenvalue; `linear` = sum F'E F; `bound` is at
    least the trace of a minimiser.
    """

    E: np.ndarray
    F: np.ndarray
    root: np.ndarray
    unroot: np.ndarray
    hessian: np.ndarray
    steepest: float
    linear: np.ndarray
    bound: float

    def value(self, Z: np.ndarray) -> float:
        return float(np.sum((self.E - self.F @ Z @ self.F.transpose(0, 2, 1)) ** 2))

    def gradient(self, Z: np.ndarray) -> np.ndarray:
        return 2 * ((self.hessian @ Z.ravel()).reshape(Z.shape) - self.linear)

    def gap(self, Z: np.ndarray) -> float:
        """f(Z) - f(Z') <= <S, Z> - <S, Z'> for the gradient S, and -<S, Z'> <= bound max(0, -min eig S)."""
        S = self.gradient(Z)
        return float(np.sum(S * Z) + self.bound * max(0.0, -np.linalg.eigvalsh(S)[0]))


def best_constant_weight(
    Ds: Matrix, Gs: Matrix, tolerance: float = 1e-12, iterations: int = 20_000
) -> ConstantWeight:
    """The one W >= 0 nearest to a schedule of D_k (T, nx, nx) and G_k (T, nx, nu); steps with D_k = 0 are left out.

    Accelerated projected gradients (eigenvalues clipped, restarted when a step turns back), until the duality gap is
    `tolerance` a step. Raises ValueError if every D_k is zero.
    """
    problem = _quadratic(Ds, Gs)
    Z = Y = np.zeros_like(problem.linear)
    step, momentum, gap = 0.5 / problem.steepest, 1.0, problem.gap(Z)
    for _ in range(iterations):
        if gap <= tolerance * len(problem.E):
            break
        after = _nearest_psd(Y - step * problem.gradient(Y))
        if np.sum((Y - after) * (after - Z)) > 0:
            momentum = 1.0
        faster = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        Y, Z, momentum = after + (momentum - 1) / faster * (after - Z), after, faster
        gap = problem.gap(Z)
    return ConstantWeight(
        problem.unroot @ Z @ problem.unroot, problem.value(Z), len(problem.E), gap
    )


def optimality_gap(Ds: Matrix, Gs: Matrix, W: Matrix) -> float:
    """By at most how much the sum of squared residuals of W >= 0 (nu, nu) is above the least over W >= 0: a bound
    from the Karush-Kuhn-Tucker conditions, zero where they hold."""
    problem = _quadratic(Ds, Gs)
    return problem.gap(problem.root @ np.asarray(W) @ problem.root)


def _quadratic(Ds: Matrix, Gs: Matrix) -> _Quadratic:
    D, G = np.asarray(Ds), np.asarray(Gs)
    size = np.linalg.norm(D, axis=(1, 2))
    if not np.any(size):
        raise ValueError("every D_k is zero: there is no diffusion to match")
    D, G, size = D[size > 0], G[size > 0], size[size > 0][:, None, None]
    E, F = D / size, G / np.sqrt(size)
    values, vectors = np.linalg.eigh(np.sum(F.transpose(0, 2, 1) @ F, axis=0))
    kept = values > _cutoff(len(values), values.dtype) * values[-1]
    basis, scales = vectors[:, kept], np.sqrt(values[kept])
    root, unroot = (basis * scales) @ basis.T, (basis / scales) @ basis.T
    F = F @ unroot
    N = F.transpose(0, 2, 1) @ F
    hessian = np.einsum("tij,tkl->ikjl", N, N).reshape(N.shape[1] ** 2, -1)
    # at a minimiser sum |F Z F'|^2 <= T, and tr(F Z F') <= sqrt(rank) |F Z F'|
    bound = len(E) * np.sqrt(min(F.shape[1:]))
    # where no G_k reaches anything, any step will do
    steepest = float(np.linalg.norm(hessian, 2)) or 1.0
    return _Quadratic(
        E, F, root, unroot, hessian, steepest, np.sum(F.transpose(0, 2, 1) @ E @ F, axis=0), bound
    )


def _nearest_psd(M: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh((M + M.T) / 2)
    return (vectors * np.maximum(values, 0)) @ vectors.T


def _floats(*matrices: Matrix) -> list[np.ndarray]:
    """As NumPy arrays in the coarsest floating point precision among them."""
    arrays = [np.asarray(M) for M in matrices]
    coarsest = max(
        (np.result_type(M, np.float32) for M in arrays), key=lambda dtype: np.finfo(dtype).eps
    )
    return [M.astype(coarsest) for M in arrays]


def _cutoff(longest: int, dtype: Any) -> float:
    """max(shape) eps."""
    return longest * float(jnp.finfo(dtype).eps)
