"""Gaussian belief dynamics (Sec. IV): filter recursion, Riccati equation, gain schedule.

    dmu     = (f(mu) + G u) dt + K dy~,    K = Sigma C' R_o^-1                       (8a)
    dSigma  = A Sigma + Sigma A' + Q - Sigma C' R_o^-1 C Sigma                       (8b)(11)
    D       = K R_o K' = Sigma C' R_o^-1 C Sigma = L L'                              (9)

with A, C the Jacobians at the mean (exact in the linear case, the EKF otherwise). `predict` and
`correct` are the same for a step dt: there K = Sigma C' S^-1 with S = C Sigma C' + R_s, and the
mean moves by an innovation of covariance K S K' = D dt.
"""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from ..discretise import euler_step, measurement_cov, measurement_difference
from ..numerics.linalg import absorb, symmetrise, triangular_root
from ..problem import Belief, Problem
from .gaussian import RootBelief, covariance, rooted


def predict(problem: Problem, belief: Belief | RootBelief, u: Array) -> RootBelief:
    """The belief one step later, before the measurement; u (nu,)."""
    return RootBelief(*_ahead(problem, belief.mean, rooted(belief), u))


def _ahead(problem: Problem, mean: Array, root: Array, u: Array) -> tuple[Array, Array]:
    """Mean and root one step later: F Sigma F' + Q dt is M M' with M = [F root, H sqrt(dt)]."""
    system, dt = problem.system, problem.dt
    F = jax.jacfwd(lambda x: euler_step(system, x, u, dt))(mean)
    return euler_step(system, mean, u, dt), triangular_root(
        jnp.hstack([F @ root, system.H * jnp.sqrt(dt)])
    )


def aimed(problem: Problem, mean: Array, root: Array, sampled: bool = True) -> Problem:
    """The problem with its sensor turned for a belief N(mean, root root'), as it is where that cannot be.

    A system may have a method `aimed(mean, root, dt, sampled)` that returns the system with the observation it takes
    of this belief, which may depend on nothing else: the filter, the plant and every plan ask here. `sampled`: the
    belief is the predicted one, before a measurement every dt; otherwise it is that of (8) at t.
    """
    turn = getattr(problem.system, "aimed", None)
    return (
        problem if turn is None else replace(problem, system=turn(mean, root, problem.dt, sampled))
    )


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
    return RootBelief(
        mean + K @ measurement_difference(problem.system, y, problem.system.c(mean)), root
    )


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


def filter_step(
    problem: Problem, mean: Array, root: Array, u: Array
) -> tuple[Array, Array, Array, Array]:
    mean, root, K, moves = _measured(problem, *_ahead(problem, mean, root, u))
    return mean, root, K, covariance(moves) / problem.dt
