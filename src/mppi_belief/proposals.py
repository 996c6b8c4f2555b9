"""Importance proposals: the feedback policies from which paths of the mean are sampled.

    u_k = v_k + K_k (mu_k - mean_k) + F_k eps_k,   eps_k ~ N(0, I)

The average (19) is over paths whose controls would be N(m_k, S_u) if they cost nothing, each counted by
exp(-S / lambda). Drawn from another density p the same paths count by the ratio of the densities as well
(Girsanov's, of a drift that depends on the path: Thijssen and Kappen 2015), so that the path cost becomes

    S + lambda ( sum_k 1/2 (u_k - m_k)' S_u^-1 (u_k - m_k) + log p(u) )

and the control for many samples is the same whatever the proposal; how many are enough is not. With
v = nominal, K = 0, F F' = S_u this is `path_integral.girsanov`: m = nominal - S_u W nominal / lambda. A W above
lambda S_u^-1 would push the controls away from the nominal; there m = 0, as for the exact W = lambda S_u^-1.

The Laplace proposal is the optimal policy of the LQ problem about the nominal, whose covariance is
F F' = lambda Quu^-1. Where the problem is that problem all its weights are equal (Kappen and Ruiz 2016). Where it is
far from it none of its samples may be any good; so a part of them is drawn about the nominal, and p is the mixture of
the two (Hesterberg 1995), with which no path counts more than 1 / DEFENSIVE times what it counts for the plain planner.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from . import ilqr
from .batching import vmap_last
from .discretise import euler_step
from .linalg import quadratic_form, symmetrise
from .path_integral import girsanov_weight
from .problem import Problem

DEFENSIVE = 0.2  # part of the samples that is drawn about the nominal; a choice


class Reference(NamedTuple):
    """The controls of a path that costs nothing, N(m_k, S_u): m (H, nu) and lambda S_u^-1 (nu, nu)."""

    centre: Array
    precision: Array


class Proposal(NamedTuple):
    """A policy: means (H, nx) and controls (H, nu), gains (H, nu, nx) about them, factors F (H, nu, nu)."""

    means: Array
    controls: Array
    gains: Array
    factors: Array


def reference(
    problem: Problem,
    nominal: Array,
    temperature: Array | float,
    std: Array | float | None,
    alpha: Array | float | None,
) -> Reference:
    """What (19) averages over about a nominal (H, nu), with the settings of `mppi_belief.controllers.MPPIBelief`."""
    R = problem.cost.R
    precision = R * problem.dt if std is None else temperature / std**2 * jnp.eye(len(R))
    taken = jnp.linalg.solve(
        precision, girsanov_weight(problem, temperature, std, alpha)
    )  # S_u or W is a multiple of I
    parts, axes = jnp.linalg.eigh(symmetrise(taken))
    return Reference(nominal - nominal @ (axes * jnp.minimum(parts, 1.0)) @ axes.T, precision)


def laplace(
    problem: Problem,
    cost: ilqr.StateCost,
    means: Array,
    nominal: Array,
    aim: Reference,
    temperature: Array | float,
) -> Proposal:
    """The optimal policy of the problem expanded about means (H+1, nx) and nominal (H, nu).

    Where that is not finite, as of costs too large for their second derivatives, it is the nominal with covariance S_u.
    """
    lq = ilqr.expand(problem, cost, means, nominal)
    found = ilqr.sweep(lq, (nominal - aim.centre) @ aim.precision, aim.precision)
    best = Proposal(means[:-1], nominal + found.feed, found.gains, jnp.linalg.cholesky(temperature * found.inverses))
    finite = jnp.all(jnp.array([jnp.all(jnp.isfinite(part)) for part in best]))
    return jax.tree.map(lambda one, other: jnp.where(finite, one, other), best, plain(means, nominal, aim, temperature))


def plain(means: Array, nominal: Array, aim: Reference, temperature: Array | float) -> Proposal:
    """Controls N(nominal_k, S_u), whatever the mean; shapes as in `laplace`."""
    spread = jnp.linalg.cholesky(temperature * jnp.linalg.inv(aim.precision))
    gains = jnp.zeros((*nominal.shape, means.shape[1]))
    return Proposal(means[:-1], nominal, gains, jnp.broadcast_to(spread, (len(nominal), *spread.shape)))


def defended(n: int) -> int:
    """How many of n samples are drawn about the nominal: at least one of two and more."""
    return max(round(DEFENSIVE * n), min(n - 1, 1))


def rollouts(
    problem: Problem, mean: Array, policies: tuple[Proposal, Proposal], others: int, normals: Array
) -> tuple[Array, Array, Array]:
    """Controls (H, nu, N) and means mu_1..mu_H (H, nx, N) from a mean (nx,) for normals (H, nu, N), and the log of the
    density that the controls were drawn from (N,), up to a constant.

    The first `others` samples are those of the second policy, the rest those of the first.
    """
    n = normals.shape[-1]
    second = jnp.arange(n) < others
    whitening = tuple(jnp.linalg.inv(policy.factors) for policy in policies)

    def advance(at: tuple[Array, Array], given: tuple) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        (mu, squares), (eps, now, whiten) = at, given

        def move(mu: Array, eps: Array, second: Array) -> tuple[Array, Array, Array]:
            centres = [one.controls + one.gains @ (mu - one.means) for one in now]
            drawn = [centre + one.factors @ eps for centre, one in zip(centres, now, strict=True)]
            u = jnp.where(second, drawn[1], drawn[0])
            off = [jnp.sum((W @ (u - centre)) ** 2) for W, centre in zip(whiten, centres, strict=True)]
            return u, euler_step(problem.system, mu, u, problem.dt), jnp.stack(off)

        u, mu, off = vmap_last(move, mapped=(True, True, True))(mu, eps, second)
        return (mu, squares + off), (u, mu)

    start = jnp.broadcast_to(mean[:, None], (len(mean), n)), jnp.zeros((2, n))
    (_, squares), (controls, means) = jax.lax.scan(advance, start, (normals, policies, whitening))
    heights = jnp.stack([jnp.sum(jnp.linalg.slogdet(W)[1]) for W in whitening])
    shares = jnp.log(jnp.array([n - others, others]) / n)
    return controls, means, jax.nn.logsumexp((shares + heights)[:, None] - 0.5 * squares, axis=0)


def correction(aim: Reference, temperature: Array | float, controls: Array, density: Array) -> Array:
    """What path costs are raised by (N,), for controls (H, nu, N) drawn from a density of this log (N,)."""
    off = controls - aim.centre[:, :, None]
    form = vmap_last(lambda d: quadratic_form(aim.precision, d), mapped=(True,))
    return 0.5 * jnp.sum(jax.vmap(form)(off), 0) + temperature * density
