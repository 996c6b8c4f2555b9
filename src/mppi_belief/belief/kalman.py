"""Gaussian belief dynamics (Sec. IV): filter recursion, Riccati equation, gain schedule.

    dmu     = (f(mu) + G u) dt + K dy~,    K = Sigma C' R_o^-1                       (8a)
    dSigma  = A Sigma + Sigma A' + Q - Sigma C' R_o^-1 C Sigma                       (8b)(11)
    D       = K R_o K' = Sigma C' R_o^-1 C Sigma = L L'                              (9)

with A, C the Jacobians at the mean (exact in the linear case, the EKF otherwise). `predict` and
`correct` are the same for a step dt: there K = Sigma C' S^-1 with S = C Sigma C' + R_s, and the
mean moves by an innovation of covariance K S K' = D dt.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ..discretise import euler_step, measurement_cov, measurement_difference, measurement_intensity
from ..numerics.linalg import decorrelated, psd_factor, semidefinite_root, symmetrise, triangular_root
from ..problem import Belief, Problem
from .gaussian import RootBelief, covariance, rooted


class GainSchedule(NamedTuple):
    """Assumption 1: what is known of the belief in advance along a nominal trajectory.

    `mean` (T+1, nx) and `cov` (T+1, nx, nx) at t_0..t_T; `gain` (T, nx, ny) and `diffusion`
    (T, nx, nx) for the steps between them.
    """

    mean: Array
    cov: Array
    gain: Array
    diffusion: Array


def predict(problem: Problem, belief: Belief | RootBelief, u: Array) -> RootBelief:
    """The belief one step later, before the measurement; u (nu,)."""
    return RootBelief(*_ahead(problem, belief.mean, rooted(belief), u))


def _ahead(problem: Problem, mean: Array, root: Array, u: Array) -> tuple[Array, Array]:
    """Mean and root one step later: F Sigma F' + Q dt is M M' with M = [F root, H sqrt(dt)]."""
    system, dt = problem.system, problem.dt
    F = jax.jacfwd(lambda x: euler_step(system, x, u, dt))(mean)
    return euler_step(system, mean, u, dt), triangular_root(jnp.hstack([F @ root, system.H * jnp.sqrt(dt)]))


def absorb(root: Array, C: Array, R_s: Array) -> tuple[Array, Array, Array]:
    """What measurements C x (ny,) with noise R_s make of a covariance root root': its new root, the gain
    K (nx, ny), and how the innovations move the mean, columns (nx, ny) with squares that add up to K S K'.

    One measurement after another, made independent first, with no matrix to invert (Potter 1963): with v = root' c and
    s = v'v + r the gain is root v / s, and the root shrinks by sqrt(r / s) along v.
    """
    C, variances = decorrelated(C, R_s)
    T, _ = decorrelated(jnp.eye(len(R_s), dtype=R_s.dtype), R_s)
    K, moves = jnp.zeros((len(root), 0), root.dtype), []
    for c, r in zip(C, variances, strict=True):
        v = c @ root
        squared = v @ v
        s = squared + r
        v = v / jnp.where(squared == 0, 1.0, jnp.sqrt(squared))
        seen = root @ v
        root = root + ((jnp.sqrt(r / s) - 1) * seen)[:, None] * v
        k = seen * (jnp.sqrt(squared) / s)
        K = jnp.column_stack([K - k[:, None] * (c @ K), k])
        moves.append(k * jnp.sqrt(s))
    return root, K @ T, jnp.stack(moves, axis=1)


def aimed(problem: Problem, mean: Array, root: Array, sampled: bool = True) -> Problem:
    """The problem with its sensor turned for a belief N(mean, root root'), as it is where that cannot be.

    A system may have a method `aimed(mean, root, dt, sampled)` that returns the system with the observation it takes
    of this belief, which may depend on nothing else: the filter, the plant and every plan ask here. `sampled`: the
    belief is the predicted one, before a measurement every dt; otherwise it is that of (8) at t.
    """
    turn = getattr(problem.system, "aimed", None)
    return problem if turn is None else replace(problem, system=turn(mean, root, problem.dt, sampled))


def aimed_ahead(problem: Problem, belief: Any, u: Array) -> Problem:
    """The problem with its sensor turned for the measurement that follows control u (nu,)."""
    if not hasattr(problem.system, "aimed"):
        return problem
    ahead = predict(problem, belief, u)
    return aimed(problem, ahead.mean, ahead.root)


def correct(problem: Problem, belief: Belief | RootBelief, y: Array) -> RootBelief:
    """The belief after the measurement y (ny,), its noise taken at the predicted mean."""
    problem = aimed(problem, belief.mean, rooted(belief))
    mean, root, K, _ = _measured(problem, belief.mean, rooted(belief))
    return RootBelief(mean + K @ measurement_difference(problem.system, y, problem.system.c(mean)), root)


def _measured(problem: Problem, mean: Array, root: Array) -> tuple[Array, Array, Array, Array]:
    """The mean as it is, and what `absorb` makes of a measurement linearised there."""
    problem = aimed(problem, mean, root)
    C, R_s = jax.jacfwd(problem.system.c)(mean), measurement_cov(problem.system, mean, problem.dt)
    return mean, *absorb(root, C, R_s)


def forecast(problem: Problem, belief: Belief | RootBelief, u: Array) -> tuple[Array, Array]:
    """What the linearised filter expects to measure after u (nu,): c at the predicted mean (ny,), and the innovation's
    covariance S = C (F Sigma F' + Q dt) C' + R_s (ny, ny)."""
    problem = aimed_ahead(problem, belief, u)
    system, dt = problem.system, problem.dt
    ahead = euler_step(system, belief.mean, u, dt)
    CF = jax.jacfwd(lambda x: system.c(euler_step(system, x, u, dt)))(belief.mean)
    noise = jax.jacfwd(system.c)(ahead) @ system.H * jnp.sqrt(dt)
    spread = symmetrise(CF @ belief.cov @ CF.T) + covariance(noise)
    return system.c(ahead), spread + measurement_cov(system, ahead, dt)


def riccati_rate(cov: Array, A: Array, Q: Array, C: Array, R_o: Array) -> Array:
    """Right-hand side of (8b)(11); all but C (ny, nx) and R_o (ny, ny) are (nx, nx)."""
    _, D = kalman_bucy(cov, C, R_o)
    return A @ cov + cov @ A.T + Q - D


def kalman_bucy(cov: Array, C: Array, R_o: Array) -> tuple[Array, Array]:
    """Gain K = Sigma C' R_o^-1 of (8a) and diffusion D = K R_o K' of (9)."""
    C, variances = decorrelated(C, R_o)
    T, _ = decorrelated(jnp.eye(len(R_o), dtype=R_o.dtype), R_o)
    spread = jnp.sqrt(jnp.stack(variances))
    moves = cov @ C.T / spread
    return moves / spread @ T, covariance(moves)


def riccati_step(cov: Array, A: Array, Q: Array, C: Array, R_o: Array, dt: Array | float) -> Array:
    """(8b)(11) solved over dt with frozen coefficients, see `riccati_root`; Q (nx, nx)."""
    return covariance(riccati_root(semidefinite_root(cov), A, Q, C, R_o, dt))


def riccati_root(root: Array, A: Array, Q: Array, C: Array, R_o: Array, dt: Array | float) -> Array:
    """The root (nx, nx) of the solution of (8b)(11) over dt with frozen coefficients, exact but for rounding.

    The Hamiltonian flow (Davison and Maki 1973) over dt / 2^s, written as the map
    Sigma -> W + F Sigma (I + J Sigma)^-1 F', which is then composed with itself s times: unlike the
    flow, the map stays bounded however well the state is seen. (I + J Sigma)^-1 is what a measurement of
    information J does, so the map keeps roots throughout.
    """
    n = root.shape[0]
    eye = jnp.eye(n, dtype=root.dtype)
    C, variances = decorrelated(C, R_o)
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
        seen, K, _ = absorb(V, N.T, eye)
        return (
            F @ (F - K @ (N.T @ F)),
            triangular_root(jnp.hstack([N, F.T @ absorb(N, V.T, eye)[0]])),
            triangular_root(jnp.hstack([V, F @ seen])),
        )

    N, V = semidefinite_root(symmetrise(top @ flow[:n, n:])), semidefinite_root(symmetrise(flow[n:, :n] @ top))
    F, N, V = jax.lax.fori_loop(0, doublings.astype(int), double, (top.T, N, V))
    return triangular_root(jnp.hstack([V, F @ absorb(root / unit, N.T, eye)[0]])) * unit


def _norm(M: Array) -> Array:
    return jnp.max(jnp.sum(jnp.abs(M), axis=0))


def _unit(norm: Array, information: Array) -> Array:
    """A unit of the state in which information counts as much as the other rates (a power of two, so exact): halved
    as often as a larger block needs, a smaller one would lose its digits."""
    known = information > 0
    return 2.0 ** jnp.where(known, jnp.round(0.5 * (jnp.log2(norm) - jnp.log2(jnp.where(known, information, 1.0)))), 0)


def gain_schedule(
    problem: Problem, belief: Belief | RootBelief, controls: Array, method: str = "filter", means: Array | None = None
) -> GainSchedule:
    """The schedule along the mean that `controls` (T, nu) lead to from `belief`, or along given `means` (T, nx) of
    t_1..t_T.

    "filter" runs the discrete recursion that the filter itself runs (D = K S K' / dt); "riccati"
    solves (11) with coefficients frozen over each step (K and D of the continuous theory, at t_k).
    """
    step = {"filter": filter_step, "riccati": _riccati_schedule_step}[method]

    def advance(at: tuple[Array, Array], given: tuple[Array, Array | None]) -> tuple[tuple[Array, Array], tuple]:
        u, replaced = given
        mean, root, gain, diffusion = step(problem, *at, u)
        mean = mean if replaced is None else replaced
        return (mean, root), (mean, covariance(root), gain, diffusion)

    start = belief.mean, rooted(belief)
    _, (mean, cov, gain, diffusion) = jax.lax.scan(advance, start, (controls, means))
    mean, cov = jnp.concatenate([belief.mean[None], mean]), jnp.concatenate([belief.cov[None], cov])
    return GainSchedule(mean, cov, gain, diffusion)


def filter_step(problem: Problem, mean: Array, root: Array, u: Array) -> tuple[Array, Array, Array, Array]:
    mean, root, K, moves = _measured(problem, *_ahead(problem, mean, root, u))
    return mean, root, K, covariance(moves) / problem.dt


def _riccati_schedule_step(problem: Problem, mean: Array, root: Array, u: Array) -> tuple[Array, Array, Array, Array]:
    system, dt = aimed(problem, mean, root, sampled=False).system, problem.dt
    A = jax.jacfwd(lambda x: system.f(x) + system.G(x) @ u)(mean)
    C = jax.jacfwd(system.c)(mean)
    R_o = measurement_intensity(system, mean, dt)
    K, D = kalman_bucy(covariance(root), C, R_o)
    return euler_step(system, mean, u, dt), riccati_root(root, A, system.H @ system.H.T, C, R_o, dt), K, D


def diffusion_factors(schedule: GainSchedule) -> tuple[Array, Array]:
    """L_k (T, nx, nx) with L_k L_k' = D_k, zero beyond the rank r_k, and r_k (T,)."""
    return jax.vmap(psd_factor)(schedule.diffusion)
