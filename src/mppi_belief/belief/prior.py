"""The prior: the belief from which every filter starts, and how the true start lies to it.

    N(prior_mean, diag(prior_std^2))                                    without `prior_modes`
    sum_i w_i N(prior_mean + prior_modes_i, diag(prior_std^2))          with them

`prior_mixture` reads the problem's fields, and all other functions derive from it: `gaussian_prior`
for filters that keep one Gaussian, `sample_prior` for particles, `draw_start` for a trial.

A trial draws a mode i with its mean m_i and an error e ~ N(0, diag(prior_std^2)). What the error
belongs to is `Problem.initial_draw`:

    state   x_0 = m_i + e     and the filter starts from the prior
    mean    x_0 = m_i         and the filter starts from the prior moved by -e
    none    x_0 = m_i         and the filter starts from the prior

The first two have the same error of estimation, from the same random numbers. With one mode the
true start of the last two is the same in all trials. With "none" the first mean is right and only
the filter does not know it: its first covariance is larger than its error.
"""

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ..numerics.normals import standard_normal
from ..numerics.square_root import psd_factor
from ..problem import Belief, Problem
from .gaussian import MixtureBelief, RootBelief, covariance

MODE_STREAM = 2**31 - 1  # folded into a key for the choice of modes; counts of draws stay below it


def prior_mixture(problem: Problem) -> MixtureBelief:
    """Returns the prior with each of its modes, of which there may be only one."""
    mean = jnp.asarray(problem.prior_mean)
    root = jnp.diag(jnp.asarray(problem.prior_std))
    means = mean[None] if problem.prior_modes is None else mean + jnp.asarray(problem.prior_modes)
    if problem.prior_weights is None:
        weights = jnp.ones(len(means), means.dtype)
    else:
        weights = jnp.asarray(problem.prior_weights)
    roots = jnp.broadcast_to(root, (len(means), *root.shape))
    return MixtureBelief(means, roots, jnp.log(weights / jnp.sum(weights)))


def gaussian_prior(problem: Problem) -> RootBelief:
    """Returns the Gaussian with the prior's mean and covariance, over all modes."""
    modes = prior_mixture(problem)
    if problem.prior_modes is None:
        return RootBelief(modes.means[0], modes.roots[0])
    return RootBelief(modes.mean, modes.root)


def prior(problem: Problem) -> Belief:
    """Returns the prior's mean (nx,) and covariance (nx, nx), over all modes."""
    modes = prior_mixture(problem)
    if problem.prior_modes is None:
        return Belief(modes.means[0], covariance(modes.roots[0]))
    return Belief(modes.mean, modes.cov)


class Start(NamedTuple):
    """Holds what a trial starts from."""

    state: Array  # x_0 (nx,), the true one
    problem: Problem  # with the prior from which filter and controller start


def draw_start(problem: Problem, key: Array) -> Start:
    """Draws the true start of a trial and the prior of its filter, as `initial_draw` says."""
    means, errors = _draw_modes_and_errors(problem, key, ())
    if problem.initial_draw == "state":
        return Start(means + errors, problem)
    if problem.initial_draw == "none":
        return Start(means, problem)
    moved = replace(problem, prior_mean=jnp.asarray(problem.prior_mean) - errors)
    return Start(means, moved)


def sample_prior(problem: Problem, key: Array, count: int | None = None) -> Array:
    """Draws one state (nx,) from the prior or, with a `count`, that many (nx, count)."""
    means, errors = _draw_modes_and_errors(problem, key, () if count is None else (count,))
    return means + errors


def _draw_modes_and_errors(
    problem: Problem, key: Array, shape: tuple[int, ...]
) -> tuple[Array, Array]:
    """Draws modes and deviations from their means: means (nx, ...) and deviations (nx, *shape)."""
    modes = prior_mixture(problem)
    normals = standard_normal(key, (modes.means.shape[1], *shape))
    if problem.prior_modes is None:
        means = modes.means[0][:, None] if shape else modes.means[0]
    else:
        # The normals use the key's counters from 0 on, so the choice has a stream of its own.
        mode_key = jax.random.fold_in(key, MODE_STREAM)
        chosen = jax.random.categorical(mode_key, modes.log_weights, shape=shape)
        means = modes.means[chosen].T
    return means, psd_factor(covariance(modes.roots[0]))[0] @ normals
