"""The matching condition (15): its residual, and the weights that meet it (Sec. V-B, Prop. 3).

    D = lambda G R^-1 G' = G W G',      epsilon(W) = |D - G W G'|_F / |D|_F

D is the diffusion of the belief mean (9). epsilon is least at W* = G^+ D G^+', which is positive
semidefinite because D is; what remains is the part of D outside the range of G, which no control
reaches.

    (i)  some W >= 0 has D = lambda G W G'     if and only if  range(D) is contained in range(G)
    (ii) some R > 0 has D = lambda G R^-1 G'   if and only if  range(D) = range(G)

Ranks, and with them ranges, are numerical: singular values count above max(shape) eps times the
largest. One W for a whole schedule, the minimum over W >= 0 of
sum_k |D_k - G_k W G_k'|^2 / |D_k|^2, is a convex problem.
"""

from typing import Any, NamedTuple

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
    inverse = jnp.linalg.pinv(G, rtol=_cutoff(max(G.shape), jnp.result_type(G, jnp.float32)))
    return inverse @ D @ inverse.T


def residual(D: Array, G: Array, W: Array) -> Array:
    """Returns epsilon(W) (), not finite for D = 0."""
    return jnp.sqrt(jnp.sum((D - G @ W @ G.T) ** 2) / jnp.sum(D**2))


def numerical_rank(M: Matrix) -> int:
    """Counts the singular values of M (m, n) above max(m, n) eps times the largest."""
    values = np.linalg.svd(_floats(M)[0], compute_uv=False)
    return int(np.sum(values > _cutoff(max(np.shape(M)), values.dtype) * values[0]))


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
    M = np.linalg.pinv(G, rcond=_cutoff(max(G.shape), G.dtype)) @ square_root
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


class ConstantWeight(NamedTuple):
    """Holds the one W for a schedule."""

    weight: np.ndarray  # W (nu, nu)
    value: float  # sum_k epsilon_k(W)^2
    steps: int  # number of terms, the steps with D_k != 0
    gap: float  # by at most which any other W >= 0 has a smaller sum


class _Quadratic(NamedTuple):
    """Represents the sum of squared residuals as a quadratic in Z = root W root.

    sum_k |D_k - G_k W G_k'|^2 / |D_k|^2 = sum_k |E_k - F_k Z F_k'|^2, sum_k F_k' F_k a projector
    """

    E: np.ndarray  # (T, nx, nx), D_k over its norm
    F: np.ndarray  # (T, nx, nu)
    root: np.ndarray  # (nu, nu)
    unroot: np.ndarray  # (nu, nu), the pseudoinverse of root
    hessian: np.ndarray  # (nu^2, nu^2), maps vec(Z) to vec(sum F'F Z F'F)
    steepest: float  # the Hessian's largest eigenvalue
    linear: np.ndarray  # sum F'E F (nu, nu)
    bound: float  # at least the trace of a minimiser

    def value(self, Z: np.ndarray) -> float:
        """Returns the sum at Z (nu, nu)."""
        return float(np.sum((self.E - self.F @ Z @ self.F.transpose(0, 2, 1)) ** 2))

    def gradient(self, Z: np.ndarray) -> np.ndarray:
        """Returns the gradient (nu, nu) at Z (nu, nu)."""
        return 2 * ((self.hessian @ Z.ravel()).reshape(Z.shape) - self.linear)

    def gap(self, Z: np.ndarray) -> float:
        """Returns a bound on f(Z) - f(Z') for every Z' >= 0.

        f(Z) - f(Z') <= <S, Z> - <S, Z'> for the gradient S, -<S, Z'> <= bound max(0, -min eig S).
        """
        S = self.gradient(Z)
        return float(np.sum(S * Z) + self.bound * max(0.0, -np.linalg.eigvalsh(S)[0]))


def best_constant_weight(
    Ds: Matrix, Gs: Matrix, tolerance: float = 1e-12, iterations: int = 20_000
) -> ConstantWeight:
    """Returns the one W >= 0 nearest to a schedule of D_k (T, nx, nx) and G_k (T, nx, nu).

    Steps with D_k = 0 are left out. Accelerated projected gradients (eigenvalues clipped, restarted
    when a step turns back) run until the duality gap is `tolerance` per step. Raises ValueError if
    every D_k is zero.
    """
    problem = _quadratic(Ds, Gs)
    Z = np.zeros_like(problem.linear)
    Y = Z
    step = 0.5 / problem.steepest
    momentum = 1.0
    gap = problem.gap(Z)
    for _ in range(iterations):
        if gap <= tolerance * len(problem.E):
            break
        projected = _nearest_psd(Y - step * problem.gradient(Y))
        if np.sum((Y - projected) * (projected - Z)) > 0:
            momentum = 1.0
        next_momentum = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        Y = projected + (momentum - 1) / next_momentum * (projected - Z)
        Z = projected
        momentum = next_momentum
        gap = problem.gap(Z)
    weight = problem.unroot @ Z @ problem.unroot
    return ConstantWeight(weight, problem.value(Z), len(problem.E), gap)


def optimality_gap(Ds: Matrix, Gs: Matrix, W: Matrix) -> float:
    """Returns a bound on the sum of squared residuals of W >= 0 (nu, nu) less the least sum.

    It follows from the Karush-Kuhn-Tucker conditions and is zero where they hold.
    """
    problem = _quadratic(Ds, Gs)
    return problem.gap(problem.root @ np.asarray(W) @ problem.root)


def _quadratic(Ds: Matrix, Gs: Matrix) -> _Quadratic:
    """Returns the sum of squared residuals over a schedule, in well-conditioned units."""
    D = np.asarray(Ds)
    G = np.asarray(Gs)
    norms = np.linalg.norm(D, axis=(1, 2))
    if not np.any(norms):
        raise ValueError("every D_k is zero: there is no diffusion to match")
    used = norms > 0
    scale = norms[used][:, None, None]
    E = D[used] / scale
    F = G[used] / np.sqrt(scale)

    # The unit of W in which the sum of F'F is a projector.
    values, vectors = np.linalg.eigh(np.sum(F.transpose(0, 2, 1) @ F, axis=0))
    reached = values > _cutoff(len(values), values.dtype) * values[-1]
    basis = vectors[:, reached]
    scales = np.sqrt(values[reached])
    root = (basis * scales) @ basis.T
    unroot = (basis / scales) @ basis.T
    F = F @ unroot

    # The quadratic's coefficients. Where no G_k reaches anything, any step will do.
    N = F.transpose(0, 2, 1) @ F
    hessian = np.einsum("tij,tkl->ikjl", N, N).reshape(N.shape[1] ** 2, -1)
    steepest = float(np.linalg.norm(hessian, 2)) or 1.0
    linear = np.sum(F.transpose(0, 2, 1) @ E @ F, axis=0)

    # At a minimiser sum |F Z F'|^2 <= T, and tr(F Z F') <= sqrt(rank) |F Z F'|.
    bound = len(E) * np.sqrt(min(F.shape[1:]))
    return _Quadratic(E, F, root, unroot, hessian, steepest, linear, bound)


def _nearest_psd(M: np.ndarray) -> np.ndarray:
    """Returns the positive semidefinite matrix nearest to M (n, n) in the Frobenius norm."""
    values, vectors = np.linalg.eigh((M + M.T) / 2)
    return (vectors * np.maximum(values, 0)) @ vectors.T


def _floats(*matrices: Matrix) -> list[np.ndarray]:
    """Returns NumPy arrays in the coarsest floating point precision among them."""
    arrays = [np.asarray(M) for M in matrices]
    coarsest = max(
        (np.result_type(M, np.float32) for M in arrays), key=lambda dtype: np.finfo(dtype).eps
    )
    return [M.astype(coarsest) for M in arrays]


def _cutoff(longest: int, dtype: Any) -> float:
    """Returns max(shape) eps, for the larger of the two sizes."""
    return longest * float(jnp.finfo(dtype).eps)
