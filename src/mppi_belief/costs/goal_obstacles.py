"""The cost of Sec. VII: reach a goal, keep clear of obstacles.

base(x)     = 1/2 |x - goal|^2_Qx
penalty(x)  = w_obs sum_j h_j(p)                            a rate, per second
terminal(x) = 1/2 |x - goal|^2_QT

with the position p of the state x and the penalty h_j of the problem's obstacle j, whose shape
(`costs.penalties`) the paper does not give.
"""

import jax.numpy as jnp
from jax import Array

from ..belief.moments import quadratic_moments
from ..numerics.linalg import as_matrix, minus, quadratic_form
from ..obstacles import Surroundings
from ..problem import CostMoments
from ..structs import ArrayField, array, number, struct
from .penalties import Bump, ObstaclePenalty
from .penalties.totals import penalty_moments, penalty_sum


@struct
class GoalObstacleCost:
    """Adds the squared distance to a goal and a penalty on every obstacle of the problem.

    Weights are diagonal (nx,) or full (nx, nx). Without obstacles the cost is quadratic.
    """

    goal: ArrayField = array(ndim=1)  # (nx,)
    running_weight: ArrayField = array(ndim=(1, 2), ge=0)  # Q^x
    terminal_weight: ArrayField = array(ndim=(1, 2), ge=0)  # Q^T
    control_weight: ArrayField = array(ndim=(1, 2), gt=0)  # R, (nu,) or (nu, nu)
    w_obs: float = number(default=0.0, ge=0)
    obstacle_penalty: ObstaclePenalty = Bump()  # h, of one obstacle

    @property
    def R(self) -> Array:
        return as_matrix(self.control_weight)

    def base(self, x: Array) -> Array:
        return 0.5 * quadratic_form(self.running_weight, minus(x, self.goal))

    def penalty(self, x: Array, surroundings: Surroundings) -> Array:
        return self.w_obs * penalty_sum(self.obstacle_penalty, x, surroundings)

    def terminal(self, x: Array) -> Array:
        return 0.5 * quadratic_form(self.terminal_weight, minus(x, self.goal))

    def running_moments(self, mean: Array, cov: Array, surroundings: Surroundings) -> CostMoments:
        """Returns (3)(4) and the variances of Remark 4, those of the base cost exact."""
        goal = jnp.asarray(self.goal)
        weight = jnp.asarray(self.running_weight)
        base, base_var = quadratic_moments(mean, cov, goal, weight)
        moments = penalty_moments(self.obstacle_penalty, mean, cov, goal, weight, surroundings)
        return CostMoments(
            base,
            self.w_obs * moments.mean,
            base_var,
            self.w_obs**2 * moments.variance,
            self.w_obs * moments.covariance,
        )

    def terminal_mean(self, mean: Array, cov: Array) -> Array:
        """Returns the expected terminal cost, exact."""
        return quadratic_moments(mean, cov, jnp.asarray(self.goal), self.terminal_weight)[0]
