"""Importance proposals: the feedback policies from which paths of the mean are sampled.

    u_k = v_k + K_k (mu_k - mean_k) + F_k eps_k,   eps_k ~ N(0, I)

The average (19) is over paths whose controls would be N(m_k, S_u) if they cost nothing, each counted by
exp(-S / lambda). Drawn from another density p the same paths count by the ratio of the densities as well
(Girsanov's, of a drift that depends on the path: Thijssen and Kappen 2015), so that the path cost becomes

    S + lambda ( sum_k 1/2 (u_k - m_k)' S_u^-1 (u_k - m_k) + log p(u) )

and the control for many samples is the same whatever the proposal; how many are enough is not. With
v = nominal, K = 0, F F' = S_u this is `path_integral.girsanov`: m = nominal - S_u W nominal / lambda. A W above
lambda S_u^-1 would push the controls away from the nominal; there, and only there, the limit is another than that
about the nominal: m = 0, as for the exact W = lambda S_u^-1.

The Laplace proposal is the optimal policy of the LQ problem about the nominal, whose covariance is
F F' = lambda Quu^-1. Where the problem is that problem all its weights are equal (Kappen and Ruiz 2016). Where it is
far from it none of its samples may be any good; so a part of them is drawn about the nominal, and p is the mixture of
the two (Hesterberg 1995), with which no path counts more than EVERY times what it counts for the plain planner.
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
from . import ilqr
from .path_integral import girsanov_weight, matched_increments

EVERY = 5  # one sample in so many is drawn about the nominal; a choice


class ReferenceDensity(NamedTuple):
    """The controls of a path that costs nothing, N(m_k, S_u): m (H, nu) and lambda S_u^-1 (nu, nu)."""

    centre: Array
    precision: Array


class FeedbackPolicy(NamedTuple):
    """A policy: means (H, nx) and controls (H, nu), gains (H, nu, nx) about them, factors F (H, nu, nu)."""

    means: Array
    controls: Array
    gains: Array
    factors: Array


def reference_density(
    problem: Problem,
    nominal: Array,
    temperature: Array | float,
    std: Array | float | None,
    alpha: Array | float | None,
) -> ReferenceDensity:
    """What (19) averages over about a nominal (H, nu), with the settings of `NominalSampler`."""
    precision = girsanov_weight(problem, temperature, std, 0.0)
    # symmetric: one of them is a multiple of the other or of I
    taken = jnp.linalg.solve(precision, girsanov_weight(problem, temperature, std, alpha))
    parts, axes = jnp.linalg.eigh(symmetrise(taken))
    return ReferenceDensity(
        nominal - nominal @ (axes * jnp.minimum(parts, 1.0)) @ axes.T, precision
    )


def nominal_policy(
    problem: Problem, nominal: Array, temperature: Array | float, std: Array | float | None
) -> FeedbackPolicy:
    """Controls N(nominal_k, S_u) about a nominal (H, nu), whatever the mean."""
    (horizon, nu), nx = nominal.shape, len(problem.prior_mean)
    units = jnp.broadcast_to(jnp.eye(nu), (horizon, nu, nu))
    factors = matched_increments(problem, units, temperature, std)
    return FeedbackPolicy(jnp.zeros((horizon, nx)), nominal, jnp.zeros((horizon, nu, nx)), factors)


def laplace_policy(
    cost: ilqr.StateCost,
    problem: Problem,
    means: Array,
    aim: ReferenceDensity,
    temperature: Array | float,
    fallback: FeedbackPolicy,
) -> FeedbackPolicy:
    """The optimal policy of the problem expanded about the means (H+1, nx) of the controls of `fallback`.

    A state whose cost has no finite derivatives counts as if it cost nothing. Where the policy is not finite all the
    same, as of derivatives that overflow, it is `fallback`.
    """
    nominal = fallback.controls
    lq = ilqr.expand(problem, cost, means, nominal)
    slopes, bends = (jnp.where(jnp.isfinite(part), part, 0.0) for part in (lq.slopes, lq.bends))
    lq = lq._replace(slopes=slopes, bends=bends)
    found = ilqr.sweep(lq, (nominal - aim.centre) @ aim.precision, aim.precision)
    factors = jnp.linalg.cholesky(temperature * found.inverses)
    best = FeedbackPolicy(means[:-1], nominal + found.feed, found.gains, factors)
    finite = jnp.all(jnp.array([jnp.all(jnp.isfinite(part)) for part in best]))
    return jax.tree.map(lambda one, other: jnp.where(finite, one, other), best, fallback)


def about_nominal(n: int, mirrored: bool) -> np.ndarray:
    """Which of n samples are drawn about the nominal (n,): one in EVERY, spread over them; of mirrored pairs
    (`path_integral.normals`) both or none."""
    return np.arange(n) % (-(-n // 2) if mirrored else n) % EVERY == 0


def feedback_rollouts(
    problem: Problem,
    mean: Array,
    policies: tuple[FeedbackPolicy, FeedbackPolicy],
    second: np.ndarray,
    normals: Array,
) -> tuple[Array, Array, Array]:
    """Controls (H, nu, N) and means mu_1..mu_H (H, nx, N) from a mean (nx,) for normals (H, nu, N), and the log of the
    density that the controls were drawn from (N,), up to a constant; `second` (N,): which are of the second policy."""
    n = normals.shape[-1]
    whitening = tuple(jnp.linalg.inv(policy.factors) for policy in policies)

    def advance(
        at: tuple[Array, Array], given: tuple
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        (mu, squares), (eps, now, whiten) = at, given

        def move(mu: Array, eps: Array, second: Array) -> tuple[Array, Array, Array]:
            centres = [one.controls + one.gains @ (mu - one.means) for one in now]
            drawn = [centre + one.factors @ eps for centre, one in zip(centres, now, strict=True)]
            u, own = jnp.where(second, drawn[1], drawn[0]), jnp.sum(eps**2)
            first, other = (
                jnp.sum((W @ (u - centre)) ** 2) for W, centre in zip(whiten, centres, strict=True)
            )
            off = jnp.stack([jnp.where(second, first, own), jnp.where(second, own, other)])
            return u, euler_step(problem.system, mu, u, problem.dt), off

        u, mu, off = vmap_last(move, mapped=(True, True, True))(mu, eps, jnp.asarray(second))
        return (mu, squares + off), (u, mu)

    start = jnp.broadcast_to(mean[:, None], (len(mean), n)), jnp.zeros((2, n))
    (_, squares), (controls, means) = jax.lax.scan(advance, start, (normals, policies, whitening))
    heights = jnp.stack([jnp.sum(jnp.linalg.slogdet(W)[1]) for W in whitening])
    shares = jnp.log(jnp.array([np.mean(~second), np.mean(second)]))
    return controls, means, jax.nn.logsumexp((shares + heights)[:, None] - 0.5 * squares, axis=0)


def density_correction(
    aim: ReferenceDensity, temperature: Array | float, controls: Array, density: Array
) -> Array:
    """What path costs are raised by (N,), for controls (H, nu, N) drawn from a density of this log (N,)."""
    off = controls - aim.centre[:, :, None]
    form = vmap_last(lambda d: quadratic_form(aim.precision, d), mapped=(True,))
    return 0.5 * jnp.sum(jax.vmap(form)(off), 0) + temperature * density
