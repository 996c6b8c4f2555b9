"""Unscented Kalman filter (Julier and Uhlmann 2004) on a cubature rule, as statistical linear regression.

Under N(mu, Sigma), Sigma = root root', x = mu + root z, the best linear fit of the measurement is

    c(x) = y^ + M' z + e,    M = E[z c'],    Omega = E[e e']           (Lefebvre, Bruyninckx and De Schutter 2002)

and the filter corrects as Kalman's does for the slope M' and the noise R_s + Omega. A = (root^-1)' M' is the best A of
Theorem 1 and Omega what it leaves: the part of c outside the tangent space of Gaussian means is taken for noise, where
the extended filter leaves it out. R_s is that at the predicted mean, as there.

Points are those of the rule of degree 5 in `numerics.quadrature`; beyond 4 states, where some of its weights are
negative, the 2 nx points of degree 3 (Arasaratnam and Haykin 2009). With no negative weight and no covariance
subtracted from another, beliefs stay roots and covariances positive semidefinite.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ..belief.gaussian import RootBelief, covariance, covariance_root
from ..belief.prior import gaussian_prior
from ..discretise import euler_step, measurement_cov, measurement_difference
from ..numerics.quadrature import sigma_points
from ..numerics.square_root import potter_update, tria
from ..problem import Belief, Correction, Problem
from ..structs import struct


class Regression(NamedTuple):
    """c(x) = expected + slope' z + e for x = mean + root z: expected (ny,), slope (nx, ny), noise (ny, ny), the
    covariance of e and of the measurement's noise."""

    expected: Array
    slope: Array
    noise: Array


@struct
class UKF:
    """Propagates mean and square root of the covariance by sigma points."""

    def init(self, problem: Problem, key: Array) -> RootBelief:
        """Returns the Gaussian with the prior's moments."""
        return gaussian_prior(problem)

    def predict(self, problem: Problem, belief: Belief | RootBelief, u: Array) -> RootBelief:
        """Returns the belief one step after control u (nu,), before the measurement."""
        return predicted(problem, belief, u)

    def correct(self, problem: Problem, belief: Belief | RootBelief, y: Array) -> Correction:
        """Corrects a predicted belief by the measurement y (ny,), by the linear regression of c."""
        root = covariance_root(belief)
        mean = belief.mean
        fit = regression(problem, RootBelief(mean, root))
        shrunk, gain, _ = potter_update(
            jnp.eye(len(mean), dtype=mean.dtype), fit.slope.T, fit.noise
        )
        innovation = measurement_difference(problem.system, y, fit.expected)
        posterior = RootBelief(mean + root @ (gain @ innovation), root @ shrunk)
        return Correction(posterior, innovation, covariance(fit.slope.T) + fit.noise)

    def update(
        self, problem: Problem, belief: Belief | RootBelief, u: Array, y: Array, key: Array
    ) -> RootBelief:
        """Returns the belief after control u (nu,) and the measurement y (ny,)."""
        return self.correct(problem, self.predict(problem, belief, u), y).posterior


def predicted(problem: Problem, belief: Belief | RootBelief, u: Array) -> RootBelief:
    """The belief one step later, before the measurement; u (nu,)."""
    system, dt, root = problem.system, problem.dt, covariance_root(belief)
    z, weights = (jnp.asarray(part, root.dtype) for part in sigma_points(len(root)))
    moved = jax.vmap(lambda point: euler_step(system, belief.mean + root @ point, u, dt))(z)
    mean = weights @ moved
    spread = (moved - mean).T * jnp.sqrt(weights)
    return RootBelief(mean, tria(jnp.hstack([spread, system.H * jnp.sqrt(dt)])))


def regression(problem: Problem, ahead: RootBelief) -> Regression:
    """The measurement's best linear fit under a belief, by the sigma points; differences are taken from c(mean)."""
    system, mean, root = problem.system, ahead.mean, ahead.root
    z, weights = (jnp.asarray(part, root.dtype) for part in sigma_points(len(root)))
    middle = system.c(mean)
    off = jax.vmap(
        lambda point: measurement_difference(system, system.c(mean + root @ point), middle)
    )(z)
    shift = weights @ off
    slope = (weights[:, None] * z).T @ (off - shift)
    left = (off - shift - z @ slope) * jnp.sqrt(weights)[:, None]
    return Regression(middle + shift, slope, measurement_cov(problem, mean) + left.T @ left)
