"""Reach a goal, keep off obstacles: the running and terminal cost of Sec. VII.

base(x)     = 1/2 |x - goal|^2_Qx
penalty(x)  = w_obs sum_j exp(-|p - z_j|^2 / (2 l^2))       a rate, per second
terminal(x) = 1/2 |x - goal|^2_QT
"""

import jax.numpy as jnp
from jax import Array

from ..belief.moments import (
    bump_sum,
    bump_sum_moments,
    quadratic_bump_covariance,
    quadratic_moments,
)
from ..numerics.linalg import as_matrix, minus, quadratic_form
from ..obstacles import Obstacles
from ..problem import CostMoments
from ..structs import array, number, struct


@struct
class GoalObstacleCost:
    """Quadratic distance to a goal plus Gaussian bumps on obstacles; weights diagonal (nx,) or full (nx, nx)."""

    goal: Array = array(ndim=1)
    running_weight: Array = array(ndim=(1, 2), ge=0)  # Q^x
    terminal_weight: Array = array(ndim=(1, 2), ge=0)
    control_weight: Array = array(ndim=(1, 2), gt=0)  # R
    obstacles: Obstacles
    w_obs: float = number(ge=0)
    bump_width: float = number(gt=0)  # l, m

    @property
    def R(self) -> Array:
        return as_matrix(self.control_weight)

    def base(self, x: Array) -> Array:
        return 0.5 * quadratic_form(self.running_weight, minus(x, self.goal))

    def penalty(self, x: Array) -> Array:
        return self.w_obs * bump_sum(x, self.obstacles.centers, self.bump_width)

    def terminal(self, x: Array) -> Array:
        return 0.5 * quadratic_form(self.terminal_weight, minus(x, self.goal))

    def running_moments(self, mean: Array, cov: Array) -> CostMoments:
        """Eqs. (3)(4) and the variances of Remark 4, exact."""
        goal = jnp.asarray(self.goal)
        base, base_var = quadratic_moments(mean, cov, goal, self.running_weight)
        if len(self.obstacles.centers) == 0:
            none = jnp.zeros_like(base)
            return CostMoments(base, none, base_var, none, none)
        centers, width = self.obstacles.centers, self.bump_width
        penalty, penalty_var = bump_sum_moments(mean, cov, centers, width)
        covariance = quadratic_bump_covariance(mean, cov, goal, self.running_weight, centers, width)
        return CostMoments(
            base,
            self.w_obs * penalty,
            base_var,
            self.w_obs**2 * penalty_var,
            self.w_obs * covariance,
        )

    def terminal_mean(self, mean: Array, cov: Array) -> Array:
        """Expected terminal cost, exact."""
        return quadratic_moments(mean, cov, jnp.asarray(self.goal), self.terminal_weight)[0]
