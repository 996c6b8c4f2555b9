"""Cost of a belief: eq. (3), eq. (4), and the risk-sensitive cost of Remark 4.

q(mu, Sigma)    = E[q(x)]
q_RS(mu, Sigma) = E[q(x)] + theta / 2 Var[q(x)]

and of a mixture sum_i w_i N(mu_i, Sigma_i), with E_i and Var_i those of its components:

E[q] = sum_i w_i E_i,    Var[q] = sum_i w_i (Var_i + (E_i - E[q])^2)
"""

import jax.numpy as jnp
from jax import Array

from ..numerics import quadrature
from ..numerics.linalg import dot
from ..problem import ClosedFormCost, CostMoments, Problem


def running_moments(problem: Problem, mean: Array, cov: Array) -> CostMoments:
    """Moments of the running cost under N(mean, cov): exact where the cost knows them, else of degree 5."""
    if isinstance(problem.cost, ClosedFormCost):
        return problem.cost.running_moments(mean, cov, problem.surroundings)
    return quadrature_moments(problem, mean, cov)


def quadrature_moments(problem: Problem, mean: Array, cov: Array) -> CostMoments:
    """The same by cubature, deviations squared after the mean is taken off."""
    base, weights = quadrature.evaluate_at_nodes(problem.cost.base, mean, cov)
    penalty, _ = quadrature.evaluate_at_nodes(problem.penalty, mean, cov)
    base_mean, penalty_mean = jnp.sum(weights * base), jnp.sum(weights * penalty)
    base, penalty = base - base_mean, penalty - penalty_mean
    return CostMoments(
        base_mean,
        penalty_mean,
        jnp.maximum(jnp.sum(weights * base**2), 0.0),
        jnp.maximum(jnp.sum(weights * penalty**2), 0.0),
        jnp.sum(weights * base * penalty),
    )


def risk_sensitive(
    problem: Problem,
    mean: Array,
    cov: Array,
    theta: Array | float,
    variance_of: str = "penalty",
    expectation: str = "exact",
) -> Array:
    """q_RS ().

    `variance_of` is what the variance is taken of: "penalty" (the obstacles) or "total" (all of q). `expectation` says
    how the obstacle penalty is expected: "exact", or "at_mean", its value at the mean, with which theta = 0
    is the certainty-equivalent planner (the rest of E[q] differs from base(mean) by the same for all paths).
    """
    m = running_moments(problem, mean, cov)
    return _charged(
        m, m.penalty if expectation == "exact" else problem.penalty(mean), theta, variance_of
    )


def _charged(m: CostMoments, penalty: Array, theta: Array | float, variance_of: str) -> Array:
    total = jnp.maximum(
        m.base_var + 2 * m.covariance + m.penalty_var, 0.0
    )  # quadrature weights may be negative
    variance = m.penalty_var if variance_of == "penalty" else total
    return m.base + penalty + 0.5 * theta * variance


def mixture_moments(problem: Problem, weights: Array, means: Array, covs: Array) -> CostMoments:
    """Moments of the running cost under sum_i w_i N(mu_i, Sigma_i); weights (m,), means (m, nx), covs (m, nx, nx).

    Those within the components and those between them: deviations from the whole's expectation are taken before
    they are multiplied, so nothing cancels. By components: an axis for them takes twice as long.
    """
    each = [running_moments(problem, mean, cov) for mean, cov in zip(means, covs, strict=True)]
    base, penalty = dot(weights, [m.base for m in each]), dot(weights, [m.penalty for m in each])
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
    expectation: str = "exact",
) -> Array:
    """q_RS () of a mixture; "at_mean" is the mean of the penalties at the components' means."""
    m = mixture_moments(problem, weights, means, covs)
    return _charged(
        m,
        m.penalty
        if expectation == "exact"
        else dot(weights, [problem.penalty(mean) for mean in means]),
        theta,
        variance_of,
    )


def certainty_equivalent(problem: Problem, mean: Array) -> Array:
    """The running cost at the mean (), blind to the covariance."""
    return problem.cost.base(mean) + problem.penalty(mean)


def expected_terminal(problem: Problem, mean: Array, cov: Array) -> Array:
    """phi(mu, Sigma) ()."""
    if isinstance(problem.cost, ClosedFormCost):
        return problem.cost.terminal_mean(mean, cov)
    return quadrature.expectation(problem.cost.terminal, mean, cov)


def mixture_terminal(problem: Problem, weights: Array, means: Array, covs: Array) -> Array:
    """The same of a mixture."""
    return dot(
        weights,
        [expected_terminal(problem, mean, cov) for mean, cov in zip(means, covs, strict=True)],
    )
