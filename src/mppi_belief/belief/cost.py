"""The cost of a belief: eq. (3), eq. (4), and the risk-sensitive cost of Remark 4.

q(mu, Sigma)    = E[q(x)]
q_RS(mu, Sigma) = E[q(x)] + theta / 2 Var[q(x)]

and of a mixture sum_i w_i N(mu_i, Sigma_i), with E_i and Var_i those of its components:

E[q] = sum_i w_i E_i,    Var[q] = sum_i w_i (Var_i + (E_i - E[q])^2)

Symbols: nx states, m components of a mixture.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from ..numerics.linalg import dot
from ..problem import ClosedFormCost, CostMoments, Problem
from .integration import StateFunction, covariance, expected_value, integrand, variance
from .moment_rules import MomentRules, RuleMoments, moments_by_rule

EXACT = MomentRules()


class ChargedMoments(NamedTuple):
    """Holds the moments of the running cost under a Gaussian, each by its own rule."""

    base: Array  # (), expectation of base, exact
    penalty: Array  # (), expectation of the penalty
    by_variance_rule: RuleMoments  # of what the variance is taken of: the penalty, or all of q


def running_moments(problem: Problem, mean: Array, cov: Array) -> CostMoments:
    """Returns the moments of the running cost under N(mean, cov), mean (nx,) and cov (nx, nx).

    They are exact where the cost has them in closed form or is quadratic, and otherwise integrated
    by a rule that is exact to degree 5.
    """
    if isinstance(problem.cost, ClosedFormCost):
        return problem.cost.running_moments(mean, cov, problem.surroundings)
    return integrated_moments(problem, mean, cov)


def expected_base(problem: Problem, mean: Array, cov: Array) -> Array:
    """Returns E[base] () under N(mean, cov), as in `running_moments`, and integrates no other."""
    if isinstance(problem.cost, ClosedFormCost):
        return problem.cost.running_moments(mean, cov, problem.surroundings).base
    name = f"cost.base of {type(problem.cost).__name__}"
    return expected_value(integrand(problem.cost.base, mean, cov, name))


def integrated_moments(problem: Problem, mean: Array, cov: Array) -> CostMoments:
    """Integrates the moments of the running cost under N(mean, cov), see `belief.integration`.

    Those of a quadratic are exact. A cost that depends on few components of the state, as on its
    position, is integrated over these.
    """
    kind = type(problem.cost).__name__
    base = integrand(problem.cost.base, mean, cov, f"cost.base of {kind}")
    penalty = integrand(problem.penalty, mean, cov, f"cost.penalty of {kind}")
    return CostMoments(
        expected_value(base),
        expected_value(penalty),
        variance(base),
        variance(penalty),
        covariance(base, penalty),
    )


def risk_sensitive(
    problem: Problem,
    mean: Array,
    cov: Array,
    theta: Array | float,
    variance_of: str = "penalty",
    rules: MomentRules = EXACT,
) -> Array:
    """Returns q_RS () of a Gaussian belief with mean (nx,) and covariance (nx, nx).

    Args:
        problem: the problem, for its cost
        mean: (nx,)
        cov: (nx, nx)
        theta: risk aversion
        variance_of: "penalty" takes the variance of the obstacle penalty, "total" that of all of q
        rules: of the penalty's expectation and of the variance; base is always expected as in (3)
    """
    charged = charged_moments(problem, mean, cov, variance_of, rules)
    return charged.base + charged.penalty + 0.5 * theta * charged.by_variance_rule.variance


def charged_moments(
    problem: Problem, mean: Array, cov: Array, variance_of: str, rules: MomentRules
) -> ChargedMoments:
    """Returns the moments of which `risk_sensitive` is made, each by its own rule."""
    if "exact" in (rules.expectation, rules.variance):
        exact = running_moments(problem, mean, cov)
        base = exact.base
    else:
        base = expected_base(problem, mean, cov)

    # The expectation of the penalty.
    spread = rules.sigma_point_spread
    if rules.expectation == "exact":
        penalty = exact.penalty
    else:
        by_rule = moments_by_rule(problem.penalty, mean, cov, rules.expectation, spread)
        penalty = by_rule.expectation

    # The variance, with the expectation that its rule takes it about.
    if rules.variance == "exact":
        center = exact.penalty if variance_of == "penalty" else exact.base + exact.penalty
        by_variance_rule = RuleMoments(center, _variance(exact, variance_of))
    else:
        function = varying_cost(problem, variance_of)
        by_variance_rule = moments_by_rule(function, mean, cov, rules.variance, spread)
    return ChargedMoments(base, penalty, by_variance_rule)


def varying_cost(problem: Problem, variance_of: str) -> StateFunction:
    """Returns the function whose variance is charged: the "penalty", or the "total" q."""
    if variance_of == "penalty":
        return problem.penalty
    return lambda x: problem.cost.base(x) + problem.penalty(x)


def _variance(moments: CostMoments, variance_of: str) -> Array:
    """Returns the variance () of the penalty or of the total cost."""
    if variance_of == "penalty":
        return moments.penalty_var
    total = moments.base_var + 2 * moments.covariance + moments.penalty_var
    return jnp.maximum(total, 0.0)  # the three parts may be integrated by different rules


def mixture_moments(problem: Problem, weights: Array, means: Array, covs: Array) -> CostMoments:
    """Returns the moments of the running cost under sum_i w_i N(mu_i, Sigma_i).

    They are those within the components and those between them. Deviations from the expectation of
    the mixture are taken before they are multiplied, so nothing cancels. The components are
    unrolled: an array axis for them takes twice as long.

    Args:
        problem: the problem, for its cost
        weights: (m,)
        means: (m, nx)
        covs: (m, nx, nx)
    """
    each = [running_moments(problem, mean, cov) for mean, cov in zip(means, covs, strict=True)]
    base = dot(weights, [m.base for m in each])
    penalty = dot(weights, [m.penalty for m in each])
    return CostMoments(
        base,
        penalty,
        dot(weights, [m.base_var + (m.base - base) ** 2 for m in each]),
        dot(weights, [m.penalty_var + (m.penalty - penalty) ** 2 for m in each]),
        dot(weights, [m.covariance + (m.base - base) * (m.penalty - penalty) for m in each]),
    )


def mixture_risk_sensitive(
    problem: Problem,
    weights: Array,
    means: Array,
    covs: Array,
    theta: Array | float,
    variance_of: str = "penalty",
    rules: MomentRules = EXACT,
) -> Array:
    """Returns q_RS () of a mixture with weights (m,), means (m, nx) and covariances (m, nx, nx).

    The other arguments are those of `risk_sensitive`. Rules are for each component; the variance of
    the mixture is that within the components and that of their expectations, by the same rule.
    """
    if rules.variance == "exact":
        moments = mixture_moments(problem, weights, means, covs)
        penalty = moments.penalty
        if rules.expectation != "exact":
            spread = rules.sigma_point_spread
            by_rule = [
                moments_by_rule(problem.penalty, mean, cov, rules.expectation, spread)
                for mean, cov in zip(means, covs, strict=True)
            ]
            penalty = dot(weights, [each.expectation for each in by_rule])
        return moments.base + penalty + 0.5 * theta * _variance(moments, variance_of)

    components = [
        charged_moments(problem, mean, cov, variance_of, rules)
        for mean, cov in zip(means, covs, strict=True)
    ]
    base = dot(weights, [c.base for c in components])
    penalty = dot(weights, [c.penalty for c in components])
    varying = [c.by_variance_rule for c in components]
    center = dot(weights, [v.expectation for v in varying])
    variance = dot(weights, [v.variance + (v.expectation - center) ** 2 for v in varying])
    return base + penalty + 0.5 * theta * variance


def certainty_equivalent(problem: Problem, mean: Array) -> Array:
    """Returns the running cost () at a mean (nx,), blind to the covariance."""
    return problem.cost.base(mean) + problem.penalty(mean)


def expected_terminal(problem: Problem, mean: Array, cov: Array) -> Array:
    """Returns phi(mu, Sigma) () for a mean (nx,) and a covariance (nx, nx)."""
    if isinstance(problem.cost, ClosedFormCost):
        return problem.cost.terminal_mean(mean, cov)
    name = f"cost.terminal of {type(problem.cost).__name__}"
    return expected_value(integrand(problem.cost.terminal, mean, cov, name))


def mixture_terminal(problem: Problem, weights: Array, means: Array, covs: Array) -> Array:
    """Returns the expected terminal cost () of a mixture, given as in `mixture_moments`."""
    components = zip(means, covs, strict=True)
    return dot(weights, [expected_terminal(problem, mean, cov) for mean, cov in components])
