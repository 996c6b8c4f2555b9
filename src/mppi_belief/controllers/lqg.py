"""LQG: exact feedback on the belief mean for a linear system and a quadratic cost; obstacles are not seen.

    u_k = feedforward_k + K_k mu_k,   K from the discrete control Riccati recursion

On a linear-quadratic problem this is what every sampling controller of this package tends to. With
obstacles it ignores them: the cost of the free road.
"""

import jax.numpy as jnp
from jax import Array

from ..planning import ilqr
from ..problem import Belief, Problem
from ..structs import choice, size, struct


@struct
class LQG:
    """One LQ solution, made at the start.

    horizon  0: over the whole trial, the optimum of (2); else the receding horizon of the other controllers
    at_step_end  charge a step for the state it leads to, or else for the one it starts from, as the reported cost does
    """

    horizon: int = size(default=0, ge=0)
    at_step_end: bool = choice(False, True, default=False)

    def init(self, problem: Problem) -> ilqr.Policy:
        """Expand about the uncontrolled mean and solve once; exact if that expansion is."""
        nominal = ilqr.still(problem, self.horizon or problem.steps)
        cost = ilqr.state_cost(problem, problem.cost.base, len(nominal.controls), self.at_step_end)
        found = ilqr.backward(problem, cost, nominal)
        return ilqr.Policy(nominal.states, nominal.controls + found.feed, found.gains)

    def act(
        self, problem: Problem, belief: Belief, plan: ilqr.Policy, key: Array
    ) -> tuple[Array, ilqr.Policy, ilqr.Info]:
        """The feedback (nu,) and the plan for the next step."""
        u = plan.controls[0] + plan.gains[0] @ (belief.mean - plan.states[0])
        nothing = jnp.full((), jnp.nan)
        info = ilqr.Info(nothing, nothing, jnp.zeros((), int), jnp.ones((), bool))
        return u, plan if self.horizon else ilqr.shifted(plan), info
