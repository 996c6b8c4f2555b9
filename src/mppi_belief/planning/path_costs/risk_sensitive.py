"""The risk-sensitive expected cost of Remark 4, of a Gaussian and of a mixture of Gaussians.

q_RS(mu, Sigma) = E[q(x)] + theta / 2 Var[q(x)]        phi(mu, Sigma) = E[terminal(x)]
"""

from jax import Array

from ...belief.cost import (
    expected_terminal,
    mixture_risk_sensitive,
    mixture_terminal,
    risk_sensitive,
)
from ...problem import Problem
from ...structs import choice, number, size, struct


@struct
class RiskSensitive:
    """Charges the expected cost and, in proportion to theta, its variance.

    Fields:
        theta: risk aversion of Remark 4
        variance_of: the variance is that of the obstacle "penalty", or of the "total" q as printed
        expectation: of the penalty: "exact" (3), or its value "at_mean", with which theta = 0 is
            certainty equivalence
        at_step_end: charge step k for the belief at t_{k+1}, or else for that at t_k
        points_per_step: of the line from belief k to belief k + 1 at which a step is charged
    """

    theta: float = number(default=0.0, ge=0)
    variance_of: str = choice("penalty", "total", default="penalty")
    expectation: str = choice("exact", "at_mean", default="exact")
    at_step_end: bool = choice(True, False, default=True)
    points_per_step: int = size(default=1)

    def running(self, problem: Problem, mean: Array, cov: Array) -> Array:
        """Returns q_RS () for a mean (nx,) and a covariance (nx, nx)."""
        return risk_sensitive(problem, mean, cov, self.theta, self.variance_of, self.expectation)

    def terminal(self, problem: Problem, mean: Array, cov: Array) -> Array:
        """Returns the expected terminal cost () for a mean (nx,) and a covariance (nx, nx)."""
        return expected_terminal(problem, mean, cov)

    def mixture_running(self, problem: Problem, weights: Array, means: Array, covs: Array) -> Array:
        """Returns q_RS () for weights (m,), means (m, nx) and covariances (m, nx, nx)."""
        return mixture_risk_sensitive(
            problem, weights, means, covs, self.theta, self.variance_of, self.expectation
        )

    def mixture_terminal(
        self, problem: Problem, weights: Array, means: Array, covs: Array
    ) -> Array:
        """Returns E[terminal] () for weights (m,), means (m, nx) and covariances (m, nx, nx)."""
        return mixture_terminal(problem, weights, means, covs)
