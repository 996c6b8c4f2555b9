"""Extended Kalman filter: the Kalman filter where the system is linear (Prop. 2, Remark 3)."""

from jax import Array

from ..belief import kalman
from ..belief.gaussian import RootBelief
from ..belief.prior import gaussian_prior
from ..problem import Belief, Correction, Problem
from ..structs import struct


@struct
class EKF:
    """Runs the recursion of `belief.kalman`, with noise and Jacobians at the predicted mean."""

    def init(self, problem: Problem, key: Array) -> RootBelief:
        """Returns the Gaussian with the prior's moments."""
        return gaussian_prior(problem)

    def predict(self, problem: Problem, belief: Belief | RootBelief, u: Array) -> RootBelief:
        """Returns the belief one step after control u (nu,), before the measurement."""
        return kalman.predict(problem, belief, u)

    def correct(self, problem: Problem, belief: Belief | RootBelief, y: Array) -> Correction:
        """Returns what the measurement y (ny,) makes of a predicted belief."""
        return kalman.correct(problem, belief, y)

    def update(
        self, problem: Problem, belief: Belief | RootBelief, u: Array, y: Array, key: Array
    ) -> RootBelief:
        """Returns the belief after control u (nu,) and the measurement y (ny,)."""
        return self.correct(problem, self.predict(problem, belief, u), y).posterior
