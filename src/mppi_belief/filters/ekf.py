"""Extended Kalman filter: the Kalman filter where the system is linear (Prop. 2, Remark 3)."""

import jax.numpy as jnp
from jax import Array

from ..belief import kalman as gaussian
from ..belief.gaussian import RootBelief, prior_mixture
from ..problem import Belief, Problem
from ..structs import struct


@struct
class EKF:
    """The discrete recursion of `mppi_belief.belief.kalman`, noise and Jacobians at the predicted mean."""

    def init(self, problem: Problem, key: Array) -> RootBelief:
        if problem.prior_modes is not None:
            whole = prior_mixture(problem)
            return RootBelief(whole.mean, whole.root)
        return RootBelief(jnp.asarray(problem.prior_mean), jnp.diag(jnp.asarray(problem.prior_std)))

    def update(
        self, problem: Problem, belief: Belief | RootBelief, u: Array, y: Array, key: Array
    ) -> RootBelief:
        return gaussian.correct(problem, gaussian.predict(problem, belief, u), y)
