"""A margin for the uncertainty: obstacles enlarged by a quantile of the position's deviation.

    q(mu, Sigma)   = E[base(x)] + penalty(mu; obstacles enlarged by k sqrt(lambda_max(Sigma_p)))
    phi(mu, Sigma) = E[terminal(x)]                               k = Phi^-1(1 - level)

with the covariance Sigma_p of the position. A convex obstacle lies on one side of a line through
the point of its surface that is nearest to the mean, and the true position is beyond this line with
probability Phi(-d / sigma), where d is the distance of the mean and sigma the deviation towards
the line. So beyond the enlarged obstacle the probability of being inside is at most `level`, per
obstacle and step. The probability of being inside at any of n steps is at most the sum of their
levels (Boole), so that level / n per step makes `level` hold for all of them jointly.

The constraint is charged by the penalty, not enforced: w_obs is the price of violating it.
Of a mixture of Gaussians every component is charged for its own enlarged obstacles, in proportion
to its weight; where all components keep to the level, the mixture does.
"""

import jax.numpy as jnp
from jax import Array
from jax.scipy.special import ndtri

from ...belief.cost import expected_base, expected_terminal, mixture_terminal
from ...numerics.linalg import dot, largest_deviation
from ...obstacles.enlarged import enlarge
from ...problem import Problem
from ...structs import choice, number, size, struct


@struct
class ChanceConstrained:
    """Charges the penalty at the mean, of obstacles that are enlarged by k standard deviations.

    Fields:
        level: of violating the constraint, in (0, 0.5]; 0.0228 is two standard deviations
        joint_steps: number of steps for which the level holds jointly; 1 gives it to every step,
            the horizon to all planned steps together
        at_step_end: charge step k for the belief at t_{k+1}, or else for that at t_k
        points_per_step: of the line from belief k to belief k + 1 at which a step is charged
    """

    level: float = number(default=0.0228, gt=0, le=0.5)
    joint_steps: int = size(default=1)
    at_step_end: bool = choice(True, False, default=True)
    points_per_step: int = size(default=1)

    @property
    def deviations(self) -> Array:
        """Returns k (), the number of standard deviations by which obstacles are enlarged."""
        return jnp.maximum(-ndtri(jnp.asarray(self.level) / self.joint_steps), 0.0)

    def running(self, problem: Problem, mean: Array, cov: Array) -> Array:
        """Returns q () for a mean (nx,) and a covariance (nx, nx)."""
        return expected_base(problem, mean, cov) + self._penalty(problem, mean, cov)

    def terminal(self, problem: Problem, mean: Array, cov: Array) -> Array:
        """Returns the expected terminal cost () for a mean (nx,) and a covariance (nx, nx)."""
        return expected_terminal(problem, mean, cov)

    def mixture_running(self, problem: Problem, weights: Array, means: Array, covs: Array) -> Array:
        """Returns q () for weights (m,), means (m, nx) and covariances (m, nx, nx)."""
        components = zip(means, covs, strict=True)
        return dot(weights, [self.running(problem, mean, cov) for mean, cov in components])

    def mixture_terminal(
        self, problem: Problem, weights: Array, means: Array, covs: Array
    ) -> Array:
        """Returns E[terminal] () for weights (m,), means (m, nx) and covariances (m, nx, nx)."""
        return mixture_terminal(problem, weights, means, covs)

    def _penalty(self, problem: Problem, mean: Array, cov: Array) -> Array:
        """Returns the penalty () at the mean, of the enlarged obstacles."""
        surroundings = problem.surroundings
        reach = self.deviations * largest_deviation(surroundings.position_cov(cov))
        return problem.cost.penalty(mean, enlarge(surroundings, reach))
