"""Extended Kalman filter: the Kalman filter where the system is linear (Prop. 2, Remark 3)."""

import jax.numpy as jnp
from jax import Array

from .. import belief as gaussian
from ..problem import Belief, Problem
from ..pytree import struct


@struct
class EKF:
    """The discrete recursion of `mppi_belief.belief`, noise and Jacobians at the predicted mean."""

    def init(self, problem: Problem, key: Array) -> gaussian.RootBelief:
        if problem.prior_modes is not None:
            whole = gaussian.prior_mixture(problem)
            return gaussian.RootBelief(whole.mean, whole.root)
        return gaussian.RootBelief(jnp.asarray(problem.prior_mean), jnp.diag(jnp.asarray(problem.prior_std)))

    def update(
        self, problem: Problem, belief: Belief | gaussian.RootBelief, u: Array, y: Array, key: Array
    ) -> gaussian.RootBelief:
        return gaussian.correct(problem, gaussian.predict(problem, belief, u), y)
