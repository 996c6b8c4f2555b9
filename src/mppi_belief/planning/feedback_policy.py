"""Feedback policies to sample controls from, and the correction of path costs for their density.

    u_k = v_k + K_k (mu_k - mean_k) + F_k eps_k,   eps_k ~ N(0, I)

The average (19) is over paths whose controls would be N(m_k, S_u) if they cost nothing, each
weighted by exp(-S / lambda). If they are drawn from another density p, each weight is multiplied by
the ratio of the two densities (Girsanov's formula for a drift that depends on the path: Thijssen
and Kappen 2015), so that the path cost becomes

    S + lambda ( sum_k 1/2 (u_k - m_k)' S_u^-1 (u_k - m_k) + log p(u) )

The control for many samples is then the same for every p; how many are enough is not. The case
v = nominal, K = 0, F F' = S_u is `path_integral.girsanov`: m = nominal - S_u W nominal / lambda.
A W above lambda S_u^-1 would push the controls away from the nominal; in this case only, the limit
differs from that of the nominal sampler: m = 0, as for the exact W = lambda S_u^-1.

The Laplace policy is the optimal policy of the LQ problem about the nominal; its covariance is
F F' = lambda Quu^-1. Where the problem is this LQ problem, all weights are equal (Kappen and Ruiz
2016). Where it is far from it, perhaps none of its samples is any good. Therefore one sample in
EVERY is drawn about the nominal, and p is the mixture of the two densities (Hesterberg 1995), under
which no path weighs more than EVERY times what it weighs for the nominal sampler.

Symbols: H steps of the horizon, N samples, nx states, nu controls.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..discretise import euler_step
from ..numerics.linalg import quadratic_form, symmetrise
from ..numerics.vmap_last import vmap_last
from ..problem import Problem
from .lq_problem import StateCost, backward_pass, expand
from .path_integral import girsanov_weight, matched_increments

EVERY = 5  # one sample in so many is drawn about the nominal; a choice


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

    A state whose cost has no finite derivatives counts as if it cost nothing. If the policy is not
    finite all the same, because derivatives overflow, it is `fallback`.

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
    lq = lq._replace(gradients=_finite(lq.gradients), hessians=_finite(lq.hessians))
    control_gradients = (nominal - reference.centre) @ reference.precision
    optimum = backward_pass(lq, control_gradients, reference.precision)
    factors = jnp.linalg.cholesky(temperature * optimum.inverses)
    policy = FeedbackPolicy(means[:-1], nominal + optimum.feedforward, optimum.gains, factors)
    finite = jnp.all(jnp.array([jnp.all(jnp.isfinite(part)) for part in policy]))
    return jax.tree.map(lambda value, default: jnp.where(finite, value, default), policy, fallback)


def _finite(derivatives: Array) -> Array:
    """Returns the derivatives with zeros where they are not finite."""
    return jnp.where(jnp.isfinite(derivatives), derivatives, 0.0)


def about_nominal(n: int, mirrored: bool) -> np.ndarray:
    """Returns which of n samples are drawn about the nominal (n,).

    They are one in EVERY, spread over the samples; of mirrored pairs (`path_integral.normals`) both
    or none.
    """
    period = -(-n // 2) if mirrored else n
    return np.arange(n) % period % EVERY == 0


def feedback_rollouts(
    problem: Problem,
    mean: Array,
    policies: tuple[FeedbackPolicy, FeedbackPolicy],
    second: np.ndarray,
    normals: Array,
) -> tuple[Array, Array, Array]:
    """Draws controls from two policies and rolls out the belief means they lead along.

    Args:
        problem: the problem, for its dynamics
        mean: (nx,) where all paths start
        policies: the two policies
        second: (N,) which samples are drawn from the second one
        normals: (H, nu, N)

    Returns:
        Controls (H, nu, N); means mu_1..mu_H (H, nx, N); the log of the mixture density that the
        controls were drawn from (N,), up to a constant.
    """
    n = normals.shape[-1]
    whitening = tuple(jnp.linalg.inv(policy.factors) for policy in policies)

    def advance(
        carry: tuple[Array, Array], inputs: tuple
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        mu, squares = carry
        eps, policies_now, whiten = inputs

        def move(mu: Array, eps: Array, second: Array) -> tuple[Array, Array, Array]:
            # Controls of both policies at this mean, of which one is drawn.
            centres = [p.controls + p.gains @ (mu - p.means) for p in policies_now]
            drawn = [c + p.factors @ eps for c, p in zip(centres, policies_now, strict=True)]
            u = jnp.where(second, drawn[1], drawn[0])

            # Squared distance of the control from both, in standard deviations.
            own = jnp.sum(eps**2)
            first_square, second_square = (
                jnp.sum((W @ (u - c)) ** 2) for W, c in zip(whiten, centres, strict=True)
            )
            from_first = jnp.where(second, first_square, own)
            from_second = jnp.where(second, own, second_square)
            next_mu = euler_step(problem.system, mu, u, problem.dt)
            return u, next_mu, jnp.stack([from_first, from_second])

        u, mu, distances = vmap_last(move, mapped=(True, True, True))(mu, eps, jnp.asarray(second))
        return (mu, squares + distances), (u, mu)

    start = (jnp.broadcast_to(mean[:, None], (len(mean), n)), jnp.zeros((2, n)))
    (_, squares), (controls, means) = jax.lax.scan(advance, start, (normals, policies, whitening))

    # The density of the mixture of both policies.
    log_peaks = jnp.stack([jnp.sum(jnp.linalg.slogdet(W)[1]) for W in whitening])
    log_shares = jnp.log(jnp.array([np.mean(~second), np.mean(second)]))
    log_terms = (log_shares + log_peaks)[:, None] - 0.5 * squares
    return controls, means, jax.nn.logsumexp(log_terms, axis=0)


def density_correction(
    reference: ReferenceDensity, temperature: Array | float, controls: Array, log_density: Array
) -> Array:
    """Returns what path costs are raised by (N,).

    Args:
        reference: the density of controls that cost nothing
        temperature: lambda
        controls: (H, nu, N) as they were drawn
        log_density: (N,) of the density they were drawn from, up to a constant
    """
    offsets = controls - reference.centre[:, :, None]
    form = vmap_last(lambda offset: quadratic_form(reference.precision, offset), mapped=(True,))
    return 0.5 * jnp.sum(jax.vmap(form)(offsets), 0) + temperature * log_density
