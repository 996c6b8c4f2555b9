"""The Riccati equation of the belief covariance (8b)(11), in continuous time."""

import jax
import jax.numpy as jnp
from jax import Array

from ..numerics.linalg import symmetrise
from ..numerics.square_root import ldl_solve, pivoted_cholesky, potter_update, tria
from .gaussian import covariance

MOST_DOUBLINGS = 120  # of the flow map, a bound on the loop whatever the rates are


def riccati_rate(cov: Array, A: Array, Q: Array, C: Array, R_o: Array) -> Array:
    """Returns the right-hand side (nx, nx) of (8b)(11).

    All arguments but C (ny, nx) and R_o (ny, ny) are (nx, nx).
    """
    _, D = kalman_bucy_gain(cov, C, R_o)
    return A @ cov + cov @ A.T + Q - D


def kalman_bucy_gain(cov: Array, C: Array, R_o: Array) -> tuple[Array, Array]:
    """Returns the gain K = Sigma C' R_o^-1 (nx, ny) of (8a) and D = K R_o K' (nx, nx) of (9)."""
    C, variances = ldl_solve(C, R_o)
    T, _ = ldl_solve(jnp.eye(len(R_o), dtype=R_o.dtype), R_o)
    deviations = jnp.sqrt(jnp.stack(variances))
    factor = cov @ C.T / deviations
    return factor / deviations @ T, covariance(factor)


def riccati_root(root: Array, A: Array, Q: Array, C: Array, R_o: Array, dt: Array | float) -> Array:
    """Returns the root (nx, nx) of the solution of (8b)(11) over dt with frozen coefficients.

    All arguments but C (ny, nx), R_o (ny, ny) and dt are (nx, nx); Sigma = root root' at the start.
    The solution is exact but for rounding. The Hamiltonian flow (Davison and Maki 1973) over
    dt / 2^s is written as the map Sigma -> W + F Sigma (I + J Sigma)^-1 F', which is then composed
    with itself s times: unlike the flow, the map stays bounded however well the state is seen.
    (I + J Sigma)^-1 is what a measurement of information J does, so the map keeps roots
    throughout.
    """
    n = root.shape[0]
    eye = jnp.eye(n, dtype=root.dtype)

    # Noise Q and information J of one step.
    C, variances = ldl_solve(C, R_o)
    whitened = C / jnp.sqrt(jnp.stack(variances))[:, None]
    Q = Q * dt
    J = whitened.T @ whitened * dt

    # The flow over so short a step that its exponential is well conditioned.
    norm = jnp.maximum(_norm(A * dt), jnp.sqrt(_norm(Q)) * jnp.sqrt(_norm(J)))
    norm = jnp.maximum(norm, 0.25)
    unit = _state_unit(norm, _norm(J))
    rate = jnp.block([[-A.T * dt, J * unit**2], [Q / unit**2, A * dt]])
    doublings = jnp.clip(jnp.ceil(jnp.log2(4 * norm)), 0, MOST_DOUBLINGS)
    flow = jax.scipy.linalg.expm(rate / 2**doublings)
    inverse = jnp.linalg.inv(flow[:n, :n])

    def double(_: Array, flow_map: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        """Composes the map with itself; J = N N', W = V V'."""
        F, N, V = flow_map
        updated, K, _ = potter_update(V, N.T, eye)
        return (
            F @ (F - K @ (N.T @ F)),
            tria(jnp.hstack([N, F.T @ potter_update(N, V.T, eye).root])),
            tria(jnp.hstack([V, F @ updated])),
        )

    N = pivoted_cholesky(symmetrise(inverse @ flow[:n, n:]))
    V = pivoted_cholesky(symmetrise(flow[n:, :n] @ inverse))
    F, N, V = jax.lax.fori_loop(0, doublings.astype(int), double, (inverse.T, N, V))
    mapped = F @ potter_update(root / unit, N.T, eye).root
    return tria(jnp.hstack([V, mapped])) * unit


def _norm(M: Array) -> Array:
    """Returns the largest column sum () of absolute values."""
    return jnp.max(jnp.sum(jnp.abs(M), axis=0))


def _state_unit(norm: Array, information: Array) -> Array:
    """Returns a unit () of the state in which information counts as much as the other rates.

    It is a power of two, so exact: the flow is halved as often as its largest block needs, and a
    smaller block would lose its digits.
    """
    known = information > 0
    exponent = 0.5 * (jnp.log2(norm) - jnp.log2(jnp.where(known, information, 1.0)))
    return 2.0 ** jnp.where(known, jnp.round(exponent), 0)
