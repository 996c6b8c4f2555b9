"""Draws paths from a mixture of two feedback policies, and corrects their costs for its density.

The average (19) is over paths whose controls would be N(m_k, S_u) if they cost nothing, each
weighted by exp(-S / lambda). If they are drawn from another density p, each weight is multiplied by
the ratio of the two densities (Girsanov's formula for a drift that depends on the path: Thijssen
and Kappen 2015), so that the path cost becomes

    S + lambda ( sum_k 1/2 (u_k - m_k)' S_u^-1 (u_k - m_k) + log p(u) )

The control for many samples is then the same for every p; how many are enough is not. Far from the
LQ problem about the nominal, perhaps none of the Laplace policy's samples is any good. Therefore
one sample in EVERY is drawn about the nominal, and p is the mixture of the two densities
(Hesterberg 1995), under which no path weighs more than EVERY times what it weighs for the nominal
sampler.

Symbols: H steps of the horizon, N samples, nx states, nu controls.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..discretise import euler_step
from ..numerics.linalg import quadratic_form
from ..numerics.vmap_last import vmap_last
from ..problem import Problem
from .feedback_policy import FeedbackPolicy, ReferenceDensity

EVERY = 5  # one sample in so many is drawn about the nominal; a choice


def about_nominal(n: int, mirrored: bool) -> np.ndarray:
    """Returns which of n samples are drawn about the nominal (n,).

    They are one in EVERY, spread over the samples; of mirrored pairs (`path_integral.normals`) both
    or none. A single sample or pair is drawn from the Laplace policy.
    """
    period = -(-n // 2) if mirrored else n
    if period == 1:
        return np.zeros(n, bool)
    return np.arange(n) % period % EVERY == 0


class _PoliciesOfStep(NamedTuple):
    """Holds both policies at one step, with the inverses of their factors."""

    policies: tuple[FeedbackPolicy, FeedbackPolicy]  # without their leading axis H
    whitening: tuple[Array, Array]  # F^-1 (nu, nu) of each


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
    whitening = (jnp.linalg.inv(policies[0].factors), jnp.linalg.inv(policies[1].factors))
    Carry = tuple[Array, Array]

    def advance(carry: Carry, step: tuple[Array, _PoliciesOfStep]) -> tuple[Carry, Carry]:
        mu, squares = carry
        eps, now = step

        def move(mu: Array, eps: Array, second: Array) -> tuple[Array, Array, Array]:
            u, distances = _drawn_control(now, mu, eps, second)
            return u, euler_step(problem.system, mu, u, problem.dt), distances

        u, mu, distances = vmap_last(move, mapped=(True, True, True))(mu, eps, jnp.asarray(second))
        return (mu, squares + distances), (u, mu)

    start = (jnp.broadcast_to(mean[:, None], (len(mean), n)), jnp.zeros((2, n)))
    steps = (normals, _PoliciesOfStep(policies, whitening))
    (_, squares), (controls, means) = jax.lax.scan(advance, start, steps)
    return controls, means, _log_density(whitening, second, squares)


def _drawn_control(
    now: _PoliciesOfStep, mu: Array, eps: Array, second: Array
) -> tuple[Array, Array]:
    """Returns a control (nu,) of one of the policies, and its squared distances (2,) from both.

    Distances are in standard deviations; `second` () says which policy the control is drawn from.
    """
    # Controls of both policies at this mean, of which one is drawn.
    centres = [p.controls + p.gains @ (mu - p.means) for p in now.policies]
    drawn = [c + p.factors @ eps for c, p in zip(centres, now.policies, strict=True)]
    u = jnp.where(second, drawn[1], drawn[0])

    # The distance from the policy that it is drawn from is that of the normals.
    own = jnp.sum(eps**2)
    first_square, second_square = (
        jnp.sum((W @ (u - c)) ** 2) for W, c in zip(now.whitening, centres, strict=True)
    )
    from_first = jnp.where(second, first_square, own)
    from_second = jnp.where(second, own, second_square)
    return u, jnp.stack([from_first, from_second])


def _log_density(whitening: tuple[Array, Array], second: np.ndarray, squares: Array) -> Array:
    """Returns the log of the mixture's density (N,), up to a constant.

    `whitening` is that of all steps (H, nu, nu), `squares` (2, N) are the squared distances of a
    path's controls from both policies, added up over the steps.
    """
    log_peaks = jnp.stack([jnp.sum(jnp.linalg.slogdet(W)[1]) for W in whitening])
    log_shares = jnp.log(jnp.array([np.mean(~second), np.mean(second)]))
    log_terms = (log_shares + log_peaks)[:, None] - 0.5 * squares
    return jax.nn.logsumexp(log_terms, axis=0)


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
