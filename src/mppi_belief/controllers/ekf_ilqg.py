"""EKF-iLQG (Todorov and Li 2005), in receding horizon (Tassa et al. 2012): plan on the belief mean.

The filter is separate (`filter=ekf`); the penalty is taken at the mean, as in CE-MPPI, over the
same horizon and cost. Each step starts from the last plan one step later, rolled out with its own
feedback.
"""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array

from ..belief.cost import certainty_equivalent
from ..planning import ilqr
from ..problem import Belief, Problem
from ..structs import choice, number, size, struct


@struct
class EKFiLQG:
    """Plans deterministically on the belief mean, to convergence at every step.

    Fields:
        horizon: H, steps
        tolerance: relative decrease of the cost at which the plan counts as converged
        max_iterations: of each control step
        damping: added to Quu once a line search has failed
        damping_factor: by which damping grows after a failure and shrinks after a success
        damping_max: where the iteration gives up
        at_step_end: charge step k for the state at t_{k+1}, or else for that at t_k
    """

    horizon: int = size(default=30)
    tolerance: float = number(default=1e-6, gt=0)
    max_iterations: int = size(default=50)
    damping: float = number(default=1e-6, gt=0)
    damping_factor: float = number(default=4.0, gt=1)
    damping_max: float = number(default=1e8, gt=0)
    at_step_end: bool = choice(True, False, default=True)

    expands_cost: ClassVar[bool] = True  # differentiates the cost

    def init(self, problem: Problem) -> ilqr.Policy:
        """Returns the plan without control."""
        return ilqr.uncontrolled(problem, self.horizon)

    def act(
        self, problem: Problem, belief: Belief, plan: ilqr.Policy, key: Array
    ) -> tuple[Array, ilqr.Policy, ilqr.ILQRInfo]:
        """Returns the control (nu,), the plan of the next step and diagnostics.

        The control is the first one of the converged plan with its feedback.
        """
        cost = ilqr.state_cost(
            problem, lambda x: certainty_equivalent(problem, x), self.horizon, self.at_step_end
        )
        settings = ilqr.ILQRSettings(
            self.tolerance, self.max_iterations, self.damping, self.damping_factor, self.damping_max
        )
        policy, value, iterations, converged = ilqr.solve(
            problem, cost, plan, belief.mean, settings
        )
        u = policy.controls[0] + policy.gains[0] @ (belief.mean - policy.states[0])
        info = ilqr.ILQRInfo(jnp.full((), jnp.nan), value, iterations, converged)
        return u, ilqr.warm_start(policy), info
