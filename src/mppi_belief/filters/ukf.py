"""Unscented Kalman filter (Julier and Uhlmann 2004) on a cubature rule, as statistical regression.

Under N(mu, Sigma), Sigma = root root', x = mu + root z, the best linear fit of the measurement is
(Lefebvre, Bruyninckx and De Schutter 2002)

    c(x) = y^ + M' z + e,    M = E[z c'],    Omega = E[e e']

and the filter corrects as Kalman's does for the slope M' and the noise R_s + Omega.
A = (root^-1)' M' is the best A of Theorem 1 and Omega what it leaves: the part of c outside the
tangent space of Gaussian means counts as noise, where the extended filter neglects it. R_s is that
at the predicted mean, as there.

Expectations are taken by `numerics.quadrature.sigma_points`. With no negative weight and no
covariance subtracted from another, beliefs stay square roots and covariances semidefinite.
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


class MeasurementRegression(NamedTuple):
    """Holds the best linear fit c(x) = expected + slope' z + e for x = mean + root z."""

    expected: Array  # y^ (ny,)
    slope: Array  # M (nx, ny)
    noise: Array  # R_s + Omega (ny, ny), of the measurement's noise and of e


@struct
class UKF:
    """Propagates mean and square root of the covariance by sigma points."""

    def init(self, problem: Problem, key: Array) -> RootBelief:
        """Returns the Gaussian with the prior's moments."""
        return gaussian_prior(problem)

    def predict(self, problem: Problem, belief: Belief | RootBelief, u: Array) -> RootBelief:
        """Returns the belief one step after control u (nu,), before the measurement."""
        return predicted_moments(problem, belief, u)

    def correct(self, problem: Problem, belief: Belief | RootBelief, y: Array) -> Correction:
        """Returns what the measurement y (ny,) makes of a predicted belief, by regression of c."""
        root = covariance_root(belief)
        mean = belief.mean
        fit = measurement_regression(problem, RootBelief(mean, root))
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


def predicted_moments(problem: Problem, belief: Belief | RootBelief, u: Array) -> RootBelief:
    """Returns the belief one step after control u (nu,), before the measurement."""
    system = problem.system
    dt = problem.dt
    root = covariance_root(belief)
    z, weights = (jnp.asarray(part, root.dtype) for part in sigma_points(len(root)))
    moved = jax.vmap(lambda point: euler_step(system, belief.mean + root @ point, u, dt))(z)
    mean = weights @ moved
    spread = (moved - mean).T * jnp.sqrt(weights)
    return RootBelief(mean, tria(jnp.hstack([spread, system.H * jnp.sqrt(dt)])))


def measurement_regression(problem: Problem, predicted: RootBelief) -> MeasurementRegression:
    """Returns the measurement's best linear fit under a predicted belief, by the sigma points.

    Measurements are compared with c(mean), from which wrapped ones differ by less than half a turn.
    """
    system = problem.system
    mean = predicted.mean
    root = predicted.root
    z, weights = (jnp.asarray(part, root.dtype) for part in sigma_points(len(root)))

    # Measurements at the sigma points, about their expectation.
    middle = system.c(mean)
    offsets = jax.vmap(
        lambda point: measurement_difference(system, system.c(mean + root @ point), middle)
    )(z)
    shift = weights @ offsets
    centred = offsets - shift

    # The slope, and what it leaves.
    slope = (weights[:, None] * z).T @ centred
    residuals = (centred - z @ slope) * jnp.sqrt(weights)[:, None]
    noise = measurement_cov(problem, mean) + residuals.T @ residuals
    return MeasurementRegression(middle + shift, slope, noise)
