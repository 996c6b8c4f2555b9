"""The Riccati equation of the belief covariance (8b)(11), in continuous time."""

import jax
import jax.numpy as jnp
from jax import Array

from ..numerics.linalg import symmetrise
from ..numerics.square_root import ldl_solve, pivoted_cholesky, potter_update, tria
from .gaussian import covariance


def riccati_rate(cov: Array, A: Array, Q: Array, C: Array, R_o: Array) -> Array:
    """Right-hand side of (8b)(11); all but C (ny, nx) and R_o (ny, ny) are (nx, nx)."""
    _, D = kalman_bucy_gain(cov, C, R_o)
    return A @ cov + cov @ A.T + Q - D


def kalman_bucy_gain(cov: Array, C: Array, R_o: Array) -> tuple[Array, Array]:
    """Gain K = Sigma C' R_o^-1 of (8a) and diffusion D = K R_o K' of (9)."""
    C, variances = ldl_solve(C, R_o)
    T, _ = ldl_solve(jnp.eye(len(R_o), dtype=R_o.dtype), R_o)
    spread = jnp.sqrt(jnp.stack(variances))
    moves = cov @ C.T / spread
    return moves / spread @ T, covariance(moves)


def riccati_step(cov: Array, A: Array, Q: Array, C: Array, R_o: Array, dt: Array | float) -> Array:
    """(8b)(11) solved over dt with frozen coefficients, see `riccati_root`; Q (nx, nx)."""
    return covariance(riccati_root(pivoted_cholesky(cov), A, Q, C, R_o, dt))


def riccati_root(root: Array, A: Array, Q: Array, C: Array, R_o: Array, dt: Array | float) -> Array:
    """The root (nx, nx) of the solution of (8b)(11) over dt with frozen coefficients, exact but for rounding.

    The Hamiltonian flow (Davison and Maki 1973) over dt / 2^s, written as the map
    Sigma -> W + F Sigma (I + J Sigma)^-1 F', which is then composed with itself s times: unlike the
    flow, the map stays bounded however well the state is seen. (I + J Sigma)^-1 is what a measurement of
    information J does, so the map keeps roots throughout.
    """
    n = root.shape[0]
    eye = jnp.eye(n, dtype=root.dtype)
    C, variances = ldl_solve(C, R_o)
    whitened = C / jnp.sqrt(jnp.stack(variances))[:, None]
    Q, J = Q * dt, whitened.T @ whitened * dt
    norm = jnp.maximum(jnp.maximum(_norm(A * dt), jnp.sqrt(_norm(Q)) * jnp.sqrt(_norm(J))), 0.25)
    unit = _unit(norm, _norm(J))
    rate = jnp.block([[-A.T * dt, J * unit**2], [Q / unit**2, A * dt]])
    doublings = jnp.clip(jnp.ceil(jnp.log2(4 * norm)), 0, 120)
    flow = jax.scipy.linalg.expm(rate / 2**doublings)
    top = jnp.linalg.inv(flow[:n, :n])

    def double(_: Array, map: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        F, N, V = map  # J = N N', W = V V'
        seen, K, _ = potter_update(V, N.T, eye)
        return (
            F @ (F - K @ (N.T @ F)),
            tria(jnp.hstack([N, F.T @ potter_update(N, V.T, eye)[0]])),
            tria(jnp.hstack([V, F @ seen])),
        )

    N, V = (
        pivoted_cholesky(symmetrise(top @ flow[:n, n:])),
        pivoted_cholesky(symmetrise(flow[n:, :n] @ top)),
    )
    F, N, V = jax.lax.fori_loop(0, doublings.astype(int), double, (top.T, N, V))
    return tria(jnp.hstack([V, F @ potter_update(root / unit, N.T, eye)[0]])) * unit


def _norm(M: Array) -> Array:
    return jnp.max(jnp.sum(jnp.abs(M), axis=0))


def _unit(norm: Array, information: Array) -> Array:
    """A unit of the state in which information counts as much as the other rates (a power of two, so exact): halved
    as often as a larger block needs, a smaller one would lose its digits."""
    known = information > 0
    return 2.0 ** jnp.where(
        known, jnp.round(0.5 * (jnp.log2(norm) - jnp.log2(jnp.where(known, information, 1.0)))), 0
    )
