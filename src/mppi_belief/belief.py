"""Gaussian belief dynamics (Sec. IV): filter recursion, Riccati equation, gain schedule.

    dmu     = (f(mu) + G u) dt + K dy~,    K = Sigma C' R_o^-1                       (8a)
    dSigma  = A Sigma + Sigma A' + Q - Sigma C' R_o^-1 C Sigma                       (8b)(11)
    D       = K R_o K' = Sigma C' R_o^-1 C Sigma = L L'                              (9)

with A, C the Jacobians at the mean (exact in the linear case, the EKF otherwise). `predict` and
`correct` are the same for a step dt: there K = Sigma C' S^-1 with S = C Sigma C' + R_s, and the
mean moves by an innovation of covariance K S K' = D dt.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from .discretise import euler_step, measurement_cov, measurement_intensity, process_cov
from .linalg import psd_factor, spd_inverse, symmetrise
from .problem import Belief, Problem


class GainSchedule(NamedTuple):
    """Assumption 1: what is known of the belief in advance along a nominal trajectory.

    `mean` (T+1, nx) and `cov` (T+1, nx, nx) at t_0..t_T; `gain` (T, nx, ny) and `diffusion`
    (T, nx, nx) for the steps between them.
    """

    mean: Array
    cov: Array
    gain: Array
    diffusion: Array


def prior(problem: Problem) -> Belief:
    """The belief before any measurement."""
    return Belief(jnp.asarray(problem.prior_mean), jnp.diag(jnp.asarray(problem.prior_std) ** 2))


def predict(problem: Problem, belief: Belief, u: Array) -> Belief:
    """The belief one step later, before the measurement; u (nu,)."""
    system, dt = problem.system, problem.dt
    F = jax.jacfwd(lambda x: euler_step(system, x, u, dt))(belief.mean)
    return Belief(euler_step(system, belief.mean, u, dt), symmetrise(F @ belief.cov @ F.T) + process_cov(system, dt))


def kalman_gain(cov: Array, C: Array, R_s: Array) -> tuple[Array, Array]:
    """Gain K = Sigma C' S^-1 (nx, ny) and innovation covariance S = C Sigma C' + R_s (ny, ny)."""
    S = symmetrise(C @ cov @ C.T) + R_s
    return cov @ C.T @ spd_inverse(S), S


def joseph(cov: Array, C: Array, R_s: Array, K: Array) -> Array:
    """Posterior covariance (I - K C) Sigma (I - K C)' + K R_s K'; PSD up to the rounding of its two terms."""
    keep = jnp.eye(cov.shape[0], dtype=cov.dtype) - K @ C
    return symmetrise(keep @ cov @ keep.T + K @ R_s @ K.T)


def correct(problem: Problem, belief: Belief, y: Array) -> Belief:
    """The belief after the measurement y (ny,), its noise taken at the predicted mean."""
    c, R_s = problem.system.c, measurement_cov(problem.system, belief.mean, problem.dt)
    C = jax.jacfwd(c)(belief.mean)
    K, _ = kalman_gain(belief.cov, C, R_s)
    return Belief(belief.mean + K @ (y - c(belief.mean)), joseph(belief.cov, C, R_s, K))


def riccati_rate(cov: Array, A: Array, Q: Array, C: Array, R_o: Array) -> Array:
    """Right-hand side of (8b)(11); all but C (ny, nx) and R_o (ny, ny) are (nx, nx)."""
    _, D = kalman_bucy(cov, C, R_o)
    return A @ cov + cov @ A.T + Q - D


def kalman_bucy(cov: Array, C: Array, R_o: Array) -> tuple[Array, Array]:
    """Gain K = Sigma C' R_o^-1 of (8a) and diffusion D = K R_o K' of (9)."""
    K = cov @ C.T @ spd_inverse(R_o)
    return K, symmetrise(K @ R_o @ K.T)


def riccati_step(cov: Array, A: Array, Q: Array, C: Array, R_o: Array, dt: Array | float) -> Array:
    """(8b)(11) solved exactly over dt with frozen coefficients.

    The Hamiltonian flow (Davison and Maki 1973) over dt / 2^s, written as the map
    Sigma -> W + F Sigma (I + J Sigma)^-1 F', which is then composed with itself s times: unlike the
    flow, the map stays bounded however well the state is seen.
    """
    n = cov.shape[0]
    eye = jnp.eye(n, dtype=cov.dtype)
    rate = jnp.block([[-A.T, C.T @ spd_inverse(R_o) @ C], [Q, A]]) * dt
    doublings = jnp.clip(jnp.ceil(jnp.log2(2 * jnp.max(jnp.sum(jnp.abs(rate), axis=0)))), 0, 120)
    flow = jax.scipy.linalg.expm(rate / 2**doublings)
    top = jnp.linalg.inv(flow[:n, :n])

    def double(_: Array, map: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        F, J, W = map
        between = F @ jnp.linalg.inv(eye + W @ J)
        return (
            between @ F,
            symmetrise(J + F.T @ J @ jnp.linalg.solve(eye + W @ J, F)),
            symmetrise(W + between @ W @ F.T),
        )

    start = (top.T, symmetrise(top @ flow[:n, n:]), symmetrise(flow[n:, :n] @ top))
    F, J, W = jax.lax.fori_loop(0, doublings.astype(int), double, start)
    return symmetrise(W + F @ cov @ jnp.linalg.solve(eye + J @ cov, F.T))


def gain_schedule(
    problem: Problem, belief: Belief, controls: Array, method: str = "filter", means: Array | None = None
) -> GainSchedule:
    """The schedule along the mean that `controls` (T, nu) lead to from `belief`, or along given `means` (T, nx) of
    t_1..t_T.

    "filter" runs the discrete recursion that the filter itself runs (D = K S K' / dt); "riccati"
    solves (11) with coefficients frozen over each step (K and D of the continuous theory, at t_k).
    """
    step = {"filter": _filter_schedule_step, "riccati": _riccati_schedule_step}[method]

    def advance(at: Belief, given: tuple[Array, Array | None]) -> tuple[Belief, tuple[Belief, Array, Array]]:
        u, mean = given
        after, gain, diffusion = step(problem, at, u)
        after = after if mean is None else after._replace(mean=mean)
        return after, (after, gain, diffusion)

    start = Belief(belief.mean, belief.cov)  # a filter's belief may hold more
    _, (after, gain, diffusion) = jax.lax.scan(advance, start, (controls, means))
    mean = jnp.concatenate([belief.mean[None], after.mean])
    cov = jnp.concatenate([belief.cov[None], after.cov])
    return GainSchedule(mean, cov, gain, diffusion)


def _filter_schedule_step(problem: Problem, at: Belief, u: Array) -> tuple[Belief, Array, Array]:
    ahead = predict(problem, at, u)
    C = jax.jacfwd(problem.system.c)(ahead.mean)
    R_s = measurement_cov(problem.system, ahead.mean, problem.dt)
    K, S = kalman_gain(ahead.cov, C, R_s)
    return Belief(ahead.mean, joseph(ahead.cov, C, R_s, K)), K, symmetrise(K @ S @ K.T) / problem.dt


def _riccati_schedule_step(problem: Problem, at: Belief, u: Array) -> tuple[Belief, Array, Array]:
    system, dt = problem.system, problem.dt
    A = jax.jacfwd(lambda x: system.f(x) + system.G(x) @ u)(at.mean)
    C = jax.jacfwd(system.c)(at.mean)
    R_o = measurement_intensity(system, at.mean, dt)
    K, D = kalman_bucy(at.cov, C, R_o)
    cov = riccati_step(at.cov, A, system.H @ system.H.T, C, R_o, dt)
    return Belief(euler_step(system, at.mean, u, dt), cov), K, D


def diffusion_factors(schedule: GainSchedule) -> tuple[Array, Array]:
    """L_k (T, nx, nx) with L_k L_k' = D_k, zero beyond the rank r_k, and r_k (T,)."""
    return jax.vmap(psd_factor)(schedule.diffusion)
