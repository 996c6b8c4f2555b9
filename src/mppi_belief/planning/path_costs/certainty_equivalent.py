"""The cost at the mean, blind to the covariance: CE-MPPI.

q(mu)   = base(mu) + penalty(mu)
phi(mu) = terminal(mu)
"""

from jax import Array

from ...belief.cost import certainty_equivalent
from ...problem import Problem
from ...structs import choice, size, struct


@struct
class CertaintyEquivalent:
    """Charges the cost at the belief mean.

    Fields:
        at_step_end: charge step k for mu_{k+1}, or else for mu_k
        points_per_step: of the line from mu_k to mu_{k+1} at which a step is charged
    """

    at_step_end: bool = choice(True, False, default=True)
    points_per_step: int = size(default=1)

    def running(self, problem: Problem, mean: Array, cov: Array) -> Array:
        """Returns the cost per second () at a mean (nx,)."""
        return certainty_equivalent(problem, mean)

    def terminal(self, problem: Problem, mean: Array, cov: Array) -> Array:
        """Returns the terminal cost () at a mean (nx,)."""
        return problem.cost.terminal(mean)
