"""The cost of Sec. VII: reach a goal, keep clear of obstacles.

base(x)     = 1/2 |x - goal|^2_Qx
penalty(x)  = w_obs sum_j exp(-|p - z_j|^2 / (2 l^2))       a rate, per second
terminal(x) = 1/2 |x - goal|^2_QT

with the position p of the state x and the centres z_j of the problem's obstacles.
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
from ..obstacles import Surroundings
from ..problem import CostMoments
from ..structs import ArrayField, array, number, struct


@struct
class GoalObstacleCost:
    """Adds the squared distance to a goal and a Gaussian bump at the centre of every obstacle.

    Weights are diagonal (nx,) or full (nx, nx). Obstacles are those of the problem; they must have
    `centers` (n, d), as `mppi_belief.Obstacles` has. Without obstacles the cost is quadratic.
    """

    goal: ArrayField = array(ndim=1)  # (nx,)
    running_weight: ArrayField = array(ndim=(1, 2), ge=0)  # Q^x
    terminal_weight: ArrayField = array(ndim=(1, 2), ge=0)  # Q^T
    control_weight: ArrayField = array(ndim=(1, 2), gt=0)  # R, (nu,) or (nu, nu)
    w_obs: float = number(default=0.0, ge=0)
    bump_width: float = number(default=1.0, gt=0)  # l, m

    @property
    def R(self) -> Array:
        return as_matrix(self.control_weight)

    def base(self, x: Array) -> Array:
        return 0.5 * quadratic_form(self.running_weight, minus(x, self.goal))

    def penalty(self, x: Array, surroundings: Surroundings) -> Array:
        centers = _centers(surroundings)
        if centers is None:
            return jnp.zeros_like(x[0])
        position = x if surroundings.position_leads else surroundings.position(x)
        return self.w_obs * bump_sum(position, centers, self.bump_width)

    def terminal(self, x: Array) -> Array:
        return 0.5 * quadratic_form(self.terminal_weight, minus(x, self.goal))

    def running_moments(self, mean: Array, cov: Array, surroundings: Surroundings) -> CostMoments:
        """Returns (3)(4) and the variances of Remark 4, exact."""
        goal = jnp.asarray(self.goal)
        weight = jnp.asarray(self.running_weight)
        centers = _centers(surroundings)

        # The closed forms of bumps take the position from the front of the state.
        if centers is not None and not surroundings.position_leads:
            order = jnp.array(surroundings.position_first(len(goal)))
            mean = mean[order]
            cov = cov[order][:, order]
            goal = goal[order]
            weight = weight[order] if weight.ndim == 1 else weight[order][:, order]

        base, base_var = quadratic_moments(mean, cov, goal, weight)
        if centers is None:
            none = jnp.zeros_like(base)
            return CostMoments(base, none, base_var, none, none)
        width = self.bump_width
        penalty, penalty_var = bump_sum_moments(mean, cov, centers, width)
        covariance = quadratic_bump_covariance(mean, cov, goal, weight, centers, width)
        return CostMoments(
            base,
            self.w_obs * penalty,
            base_var,
            self.w_obs**2 * penalty_var,
            self.w_obs * covariance,
        )

    def terminal_mean(self, mean: Array, cov: Array) -> Array:
        """Returns the expected terminal cost, exact."""
        return quadratic_moments(mean, cov, jnp.asarray(self.goal), self.terminal_weight)[0]


def _centers(surroundings: Surroundings) -> Array | None:
    """Returns the centres (n, d) of the obstacles, None without any; raises `ValueError`."""
    obstacles = surroundings.obstacles
    if obstacles is None:
        return None
    centers = getattr(obstacles, "centers", None)
    if centers is None:
        kind = type(obstacles).__name__
        raise ValueError(f"GoalObstacleCost needs obstacles with centers, {kind} has none")
    return centers if len(centers) else None
