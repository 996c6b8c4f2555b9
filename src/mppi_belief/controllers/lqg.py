"""LQG: exact feedback on the belief mean for a linear system and a quadratic cost.

    u_k = feedforward_k + K_k mu_k,   K from the discrete control Riccati recursion

On a linear-quadratic problem every sampling controller of this package tends to it. It does not see
obstacles, so its cost is that of the problem without them.
"""

import jax.numpy as jnp
from jax import Array

from ..planning import ilqr
from ..problem import Belief, Problem
from ..structs import choice, size, struct


@struct
class LQG:
    """Follows one LQ solution, computed at the start.

    Fields:
        horizon: 0 plans over the whole trial, the optimum of (2); else the receding horizon of the
            other controllers
        at_step_end: charge step k for the state at t_{k+1}, or else for that at t_k, as the
            reported cost does
    """

    horizon: int = size(default=0, ge=0)
    at_step_end: bool = choice(False, True, default=False)

    def init(self, problem: Problem) -> ilqr.Policy:
        """Returns the solution about the uncontrolled mean, exact for an LQ problem."""
        nominal = ilqr.uncontrolled(problem, self.horizon or problem.steps)
        cost = ilqr.state_cost(problem, problem.cost.base, len(nominal.controls), self.at_step_end)
        improvement = ilqr.lq_improvement(problem, cost, nominal)
        controls = nominal.controls + improvement.feedforward
        return ilqr.Policy(nominal.states, controls, improvement.gains)

    def act(
        self, problem: Problem, belief: Belief, plan: ilqr.Policy, key: Array
    ) -> tuple[Array, ilqr.Policy, ilqr.ILQRInfo]:
        """Returns the feedback (nu,), the plan of the next step and diagnostics."""
        u = plan.controls[0] + plan.gains[0] @ (belief.mean - plan.states[0])
        undefined = jnp.full((), jnp.nan)
        info = ilqr.ILQRInfo(undefined, undefined, jnp.zeros((), int), jnp.ones((), bool))
        return u, plan if self.horizon else ilqr.warm_start(plan), info
