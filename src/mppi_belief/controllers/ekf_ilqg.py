"""EKF-iLQG (Todorov and Li 2005), in receding horizon (Tassa et al. 2012): plan on the belief mean.

The filter is separate (`filter=ekf`); the penalty is taken at the mean, as in CE-MPPI, over the same
horizon and cost. Each step starts from the last plan, shifted and followed with its own feedback.
"""

import jax.numpy as jnp
from jax import Array

from ..belief.cost import certainty_equivalent
from ..planning import ilqr
from ..problem import Belief, Problem
from ..structs import choice, number, size, struct


@struct
class EKFiLQG:
    """Deterministic planner on the belief mean.

    tolerance       relative decrease of the cost at which the plan counts as converged
    max_iterations  of each control step
    damping, damping_factor, damping_max   the regularisation added to Quu: where it starts when a line
                    search fails, how it grows and shrinks, where the iteration gives up
    at_step_end     charge a step for the state it leads to, or else for the one it starts from
    """

    horizon: int = size(default=30)
    tolerance: float = number(default=1e-6, gt=0)
    max_iterations: int = size(default=50)
    damping: float = number(default=1e-6, gt=0)
    damping_factor: float = number(default=4.0, gt=1)
    damping_max: float = number(default=1e8, gt=0)
    at_step_end: bool = choice(True, False, default=True)

    def init(self, problem: Problem) -> ilqr.Policy:
        """No control."""
        return ilqr.still(problem, self.horizon)

    def act(
        self, problem: Problem, belief: Belief, plan: ilqr.Policy, key: Array
    ) -> tuple[Array, ilqr.Policy, ilqr.Info]:
        """The converged plan's first control with its feedback (nu,), the plan shifted by one step, diagnostics."""
        cost = ilqr.state_cost(
            problem, lambda x: certainty_equivalent(problem, x), self.horizon, self.at_step_end
        )
        settings = ilqr.Settings(
            self.tolerance, self.max_iterations, self.damping, self.damping_factor, self.damping_max
        )
        policy, value, iterations, converged = ilqr.solve(
            problem, cost, plan, belief.mean, settings
        )
        u = policy.controls[0] + policy.gains[0] @ (belief.mean - policy.states[0])
        return (
            u,
            ilqr.shifted(policy),
            ilqr.Info(jnp.full((), jnp.nan), value, iterations, converged),
        )
