"""Feedback policies to sample controls from: about the nominal, and the Laplace approximation.

    u_k = v_k + K_k (mu_k - mean_k) + F_k eps_k,   eps_k ~ N(0, I)

The average (19) is over paths whose controls would be N(m_k, S_u) if they cost nothing;
`policy_mixture` corrects the costs of paths that are drawn from another density. The case
v = nominal, K = 0, F F' = S_u is `path_integral.girsanov`: m = nominal - S_u W nominal / lambda.
A W above lambda S_u^-1 would push the controls away from the nominal; in this case only, the limit
differs from that of the nominal sampler: m = 0, as for the exact W = lambda S_u^-1.

The Laplace policy is the optimal policy of the LQ problem about the nominal; its covariance is
F F' = lambda Quu^-1. Where the problem is this LQ problem, all weights are equal (Kappen and Ruiz
2016).

Symbols: H steps of the horizon, nx states, nu controls.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ..numerics.linalg import symmetrise
from ..problem import Problem
from .lq_problem import StateCost, backward_pass, expand
from .path_integral import girsanov_weight, matched_increments


class ReferenceDensity(NamedTuple):
    """Represents the density N(m_k, S_u) of the controls of a path that costs nothing."""

    centre: Array  # m (H, nu)
    precision: Array  # lambda S_u^-1 (nu, nu)


class FeedbackPolicy(NamedTuple):
    """Represents Gaussian controls about a feedback law."""

    means: Array  # (H, nx): belief means about which the feedback acts
    controls: Array  # v (H, nu)
    gains: Array  # K (H, nu, nx)
    factors: Array  # F (H, nu, nu)


def reference_density(
    problem: Problem,
    nominal: Array,
    temperature: Array | float,
    std: Array | float | None,
    alpha: Array | float | None,
) -> ReferenceDensity:
    """Returns the density that (19) averages over about a nominal (H, nu).

    The settings are those of `NominalSampler`.
    """
    precision = girsanov_weight(problem, temperature, std, 0.0)

    # The part of the nominal that m leaves out, at most all of it. The matrix is symmetric, since
    # one of the two weights is a multiple of the other or of I.
    weight = girsanov_weight(problem, temperature, std, alpha)
    parts, axes = jnp.linalg.eigh(symmetrise(jnp.linalg.solve(precision, weight)))
    left_out = nominal @ (axes * jnp.minimum(parts, 1.0)) @ axes.T
    return ReferenceDensity(nominal - left_out, precision)


def nominal_policy(
    problem: Problem, nominal: Array, temperature: Array | float, std: Array | float | None
) -> FeedbackPolicy:
    """Returns the policy N(nominal_k, S_u) about a nominal (H, nu), without feedback."""
    horizon, nu = nominal.shape
    nx = len(problem.prior_mean)
    units = jnp.broadcast_to(jnp.eye(nu), (horizon, nu, nu))
    factors = matched_increments(problem, units, temperature, std)
    return FeedbackPolicy(jnp.zeros((horizon, nx)), nominal, jnp.zeros((horizon, nu, nx)), factors)


def laplace_policy(
    cost: StateCost,
    problem: Problem,
    means: Array,
    reference: ReferenceDensity,
    temperature: Array | float,
    fallback: FeedbackPolicy,
) -> FeedbackPolicy:
    """Returns the optimal policy of the problem expanded about the controls of `fallback`.

    If the policy is not finite, because derivatives overflow, it is `fallback`.

    Args:
        cost: of a mean at a step
        problem: the problem, for its dynamics
        means: (H+1, nx) along the controls of `fallback`
        reference: the density of controls that cost nothing
        temperature: lambda
        fallback: the policy about the nominal
    """
    nominal = fallback.controls
    lq = expand(problem, cost, means, nominal)
    control_gradients = (nominal - reference.centre) @ reference.precision
    optimum = backward_pass(lq, control_gradients, reference.precision)
    factors = jnp.linalg.cholesky(temperature * optimum.inverses)
    policy = FeedbackPolicy(means[:-1], nominal + optimum.feedforward, optimum.gains, factors)
    finite = jnp.all(jnp.array([jnp.all(jnp.isfinite(part)) for part in policy]))
    return jax.tree.map(lambda value, default: jnp.where(finite, value, default), policy, fallback)
