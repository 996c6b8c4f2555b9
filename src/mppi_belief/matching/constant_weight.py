"""One weight W for a whole schedule of matching conditions (15).

    minimise  sum_k |D_k - G_k W G_k'|^2 / |D_k|^2   over W >= 0

is a convex problem. It is solved by projected gradients, with a bound on how far the result is from
the minimum.
"""

from typing import NamedTuple

import numpy as np

from .weights import Matrix, rank_cutoff


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
        projected = nearest_psd(Y - step * problem.gradient(Y))
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
    reached = values > rank_cutoff(len(values), values.dtype) * values[-1]
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


def nearest_psd(M: np.ndarray) -> np.ndarray:
    """Returns the positive semidefinite matrix nearest to M (n, n) in the Frobenius norm."""
    values, vectors = np.linalg.eigh((M + M.T) / 2)
    return (vectors * np.maximum(values, 0)) @ vectors.T
