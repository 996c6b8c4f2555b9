"""Gaussian belief dynamics (Sec. IV): the filter recursion over a time step.

    dmu     = (f(mu) + G u) dt + K dy~,    K = Sigma C' R_o^-1                       (8a)
    dSigma  = A Sigma + Sigma A' + Q - Sigma C' R_o^-1 C Sigma                       (8b)(11)
    D       = K R_o K' = Sigma C' R_o^-1 C Sigma = L L'                              (9)

with A, C the Jacobians at the mean (exact in the linear case, the EKF otherwise). `riccati.py`
solves (8b)(11) in continuous time. `predict` and `correct` are the same for a step dt: there
K = Sigma C' S^-1 with S = C Sigma C' + R_s, and the mean moves by K times an innovation of
covariance S, so its increment has the covariance K S K' = D dt.
"""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from ..discretise import euler_step, measurement_cov, measurement_difference
from ..numerics.square_root import potter_update, tria
from ..problem import Belief, Correction, Problem, SteerableSensor
from .gaussian import RootBelief, covariance, covariance_root


def predict(problem: Problem, belief: Belief | RootBelief, u: Array) -> RootBelief:
    """Returns the belief one step after control u (nu,), before the measurement."""
    return RootBelief(*_predict_moments(problem, belief.mean, covariance_root(belief), u))


def _predict_moments(problem: Problem, mean: Array, root: Array, u: Array) -> tuple[Array, Array]:
    """Returns mean and root one step later, F Sigma F' + Q dt = M M', M = [F root, H sqrt(dt)]."""
    system = problem.system
    dt = problem.dt
    F = jax.jacfwd(lambda x: euler_step(system, x, u, dt))(mean)
    columns = jnp.hstack([F @ root, system.H * jnp.sqrt(dt)])
    return euler_step(system, mean, u, dt), tria(columns)


def aim_sensor(problem: Problem, mean: Array, root: Array, sampled: bool = True) -> Problem:
    """Returns the problem with its sensor turned for a belief N(mean, root root').

    Systems without a `SteerableSensor` stay as they are; `sampled` is explained there.
    """
    if not isinstance(problem.system, SteerableSensor):
        return problem
    return replace(problem, system=problem.system.aimed(problem, mean, root, sampled))


def aim_sensor_ahead(problem: Problem, belief: Any, u: Array) -> Problem:
    """Returns the problem with its sensor turned for the measurement after control u (nu,)."""
    if not isinstance(problem.system, SteerableSensor):
        return problem
    predicted = predict(problem, belief, u)
    return aim_sensor(problem, predicted.mean, predicted.root)


def correct(problem: Problem, belief: Belief | RootBelief, y: Array) -> Correction:
    """Returns what the measurement y (ny,) makes of a predicted belief, noise at its mean."""
    mean = belief.mean
    root = covariance_root(belief)
    problem = aim_sensor(problem, mean, root)
    C, R_s = _linearised_measurement(problem, mean)
    corrected_root, gain, _ = potter_update(root, C, R_s)
    innovation = measurement_difference(problem.system, y, problem.system.c(mean))
    posterior = RootBelief(mean + gain @ innovation, corrected_root)
    factor = C @ root
    return Correction(posterior, innovation, factor @ factor.T + R_s)


def filter_step(
    problem: Problem, mean: Array, root: Array, u: Array
) -> tuple[Array, Array, Array, Array]:
    """Returns the belief's step under control u (nu,) that does not depend on the measurement.

    That is the predicted mean (nx,), the corrected root (nx, nx), the gain K (nx, ny) and the
    diffusion D (nx, nx) of the mean.
    """
    mean, root = _predict_moments(problem, mean, root, u)
    problem = aim_sensor(problem, mean, root)
    root, gain, moves = potter_update(root, *_linearised_measurement(problem, mean))
    return mean, root, gain, covariance(moves) / problem.dt


def _linearised_measurement(problem: Problem, mean: Array) -> tuple[Array, Array]:
    """Returns the Jacobian C (ny, nx) and the noise covariance R_s (ny, ny) at a mean (nx,)."""
    C = jax.jacfwd(problem.system.c)(mean)
    return C, measurement_cov(problem, mean)
