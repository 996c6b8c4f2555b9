"""Importance proposals: the feedback policy from which paths of the mean are sampled.

    u_k = v_k + K_k (mu_k - mean_k) + F_k eps_k,   eps_k ~ N(0, I)

The average (19) is over paths whose controls would be N(m_k, S_u) if they cost nothing, each counted by
exp(-S / lambda). Sampled from another policy the same paths count by the ratio of the densities as well
(Girsanov's, of a drift that depends on the path: Thijssen and Kappen 2015), so that the path cost becomes

    S + lambda sum_k ( 1/2 (u_k - m_k)' S_u^-1 (u_k - m_k) - 1/2 eps_k' eps_k )

and the control for many samples is the same whatever the proposal; how many are enough is not. With
v = nominal, K = 0, F F' = S_u this is `path_integral.girsanov`: m = nominal - S_u W nominal / lambda.

The Laplace proposal is the optimal policy of the LQ problem about the nominal, whose covariance is
F F' = lambda Quu^-1. Where the problem is that problem all weights are equal (Kappen and Ruiz 2016).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from . import ilqr
from .batching import vmap_last
from .discretise import euler_step
from .linalg import quadratic_form
from .path_integral import girsanov_weight
from .problem import Problem


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
    pulled = nominal @ girsanov_weight(problem, temperature, std, alpha)
    return Reference(nominal - jnp.linalg.solve(precision, pulled.T).T, precision)


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
    best = nominal + found.feed, found.gains, jnp.linalg.cholesky(temperature * found.inverses)
    spread = jnp.linalg.cholesky(temperature * jnp.linalg.inv(aim.precision))
    plain = nominal, jnp.zeros_like(found.gains), jnp.broadcast_to(spread, found.inverses.shape)
    finite = jnp.all(jnp.array([jnp.all(jnp.isfinite(part)) for part in best]))
    return Proposal(means[:-1], *(jnp.where(finite, one, other) for one, other in zip(best, plain, strict=True)))


def rollouts(problem: Problem, mean: Array, proposal: Proposal, normals: Array) -> tuple[Array, Array]:
    """Controls (H, nu, N) and means mu_1..mu_H (H, nx, N) of the policy from a mean (nx,), for normals (H, nu, N)."""

    def one(mu: Array, eps: Array, at: Array, v: Array, K: Array, F: Array) -> tuple[Array, Array]:
        u = v + K @ (mu - at) + F @ eps
        return u, euler_step(problem.system, mu, u, problem.dt)

    move = vmap_last(one, mapped=(True, True, False, False, False, False))

    def advance(mu: Array, at: tuple[Array, Proposal]) -> tuple[Array, tuple[Array, Array]]:
        eps, policy = at
        u, mu = move(mu, eps, *policy)
        return mu, (u, mu)

    starts = jnp.broadcast_to(mean[:, None], (len(mean), normals.shape[-1]))
    return jax.lax.scan(advance, starts, (normals, proposal))[1]


def correction(aim: Reference, temperature: Array | float, controls: Array, normals: Array) -> Array:
    """lambda times the log of the ratio of densities (N,), for controls and normals (H, nu, N); up to a constant."""
    off = controls - aim.centre[:, :, None]
    form = vmap_last(lambda d: quadratic_form(aim.precision, d), mapped=(True,))
    return 0.5 * (jnp.sum(jax.vmap(form)(off), 0) - temperature * jnp.sum(normals * normals, (0, 1)))
