"""The risk-sensitive expected cost of Remark 4, of a Gaussian and of a mixture of Gaussians.

q_RS(mu, Sigma) = E[q(x)] + theta / 2 Var[q(x)]        phi(mu, Sigma) = E[terminal(x)]
"""

import jax.numpy as jnp
from jax import Array

from ...belief.cost import (
    expected_terminal,
    mixture_risk_sensitive,
    mixture_terminal,
    risk_sensitive,
    varying_cost,
)
from ...belief.moment_rules import CUBATURE_SPREAD, RULES, MomentRules, check_spread
from ...problem import Problem
from ...structs import choice, number, size, struct


@struct
class RiskSensitive:
    """Charges the expected cost and, in proportion to theta, its variance.

    The base cost is always expected as in (3). The paper does not say by which rule it takes the
    other moments; `belief.moment_rules` has the equations of all of them.

    Fields:
        theta: risk aversion of Remark 4
        variance_of: the variance is that of the obstacle "penalty", or of the "total" q as printed
        expectation: of the penalty: "exact" (3), by "sigma_points", by its "delta" expansion to
            second order, or its value "at_mean", with which theta = 0 is certainty equivalence
        variance: "exact", by "sigma_points", by the "delta" expansion to first order, or none
            ("at_mean")
        sigma_point_spread: c; sigma points are sqrt(c) standard deviations from the mean
        at_step_end: charge step k for the belief at t_{k+1}, or else for that at t_k
        points_per_step: of the line from belief k to belief k + 1 at which a step is charged
    """

    theta: float = number(default=0.0, ge=0)
    variance_of: str = choice("penalty", "total", default="penalty")
    expectation: str = choice(*RULES, default="exact")
    variance: str = choice(*RULES, default="exact")
    sigma_point_spread: float = number(default=CUBATURE_SPREAD, gt=0)
    at_step_end: bool = choice(True, False, default=True)
    points_per_step: int = size(default=1)

    @property
    def rules(self) -> MomentRules:
        """Returns the rules by which moments are taken."""
        return MomentRules(self.expectation, self.variance, self.sigma_point_spread)

    @property
    def expands_cost(self) -> bool:
        """Says whether the cost is differentiated."""
        return "delta" in (self.expectation, self.variance)

    def check_fit(self, problem: Problem) -> None:
        """Raises `ValueError` for sigma points of which the mean's would have a negative weight."""
        mean = jnp.asarray(problem.prior_mean)
        if self.expectation == "sigma_points":
            check_spread(problem.penalty, mean, self.sigma_point_spread)
        if self.variance == "sigma_points":
            check_spread(varying_cost(problem, self.variance_of), mean, self.sigma_point_spread)

    def running(self, problem: Problem, mean: Array, cov: Array) -> Array:
        """Returns q_RS () for a mean (nx,) and a covariance (nx, nx)."""
        return risk_sensitive(problem, mean, cov, self.theta, self.variance_of, self.rules)

    def terminal(self, problem: Problem, mean: Array, cov: Array) -> Array:
        """Returns the expected terminal cost () for a mean (nx,) and a covariance (nx, nx)."""
        return expected_terminal(problem, mean, cov)

    def mixture_running(self, problem: Problem, weights: Array, means: Array, covs: Array) -> Array:
        """Returns q_RS () for weights (m,), means (m, nx) and covariances (m, nx, nx)."""
        return mixture_risk_sensitive(
            problem, weights, means, covs, self.theta, self.variance_of, self.rules
        )

    def mixture_terminal(
        self, problem: Problem, weights: Array, means: Array, covs: Array
    ) -> Array:
        """Returns E[terminal] () for weights (m,), means (m, nx) and covariances (m, nx, nx)."""
        return mixture_terminal(problem, weights, means, covs)
