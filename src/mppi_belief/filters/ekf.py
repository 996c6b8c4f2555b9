"""Extended Kalman filter: the Kalman filter where the system is linear (Prop. 2, Remark 3)."""

from jax import Array

from .. import belief as gaussian
from ..problem import Belief, Problem
from ..pytree import struct


@struct
class EKF:
    """The discrete recursion of `mppi_belief.belief`, noise and Jacobians at the predicted mean."""

    def init(self, problem: Problem, key: Array) -> Belief:
        return gaussian.prior(problem)

    def update(self, problem: Problem, belief: Belief, u: Array, y: Array, key: Array) -> Belief:
        return gaussian.update(problem, belief, u, y)
