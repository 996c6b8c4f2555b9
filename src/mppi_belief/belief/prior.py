"""The prior: the belief from which every filter starts and from which true states are drawn.

    N(prior_mean, diag(prior_std^2))                                    without `prior_modes`
    sum_i w_i N(prior_mean + prior_modes_i, diag(prior_std^2))          with them

`prior_mixture` reads the problem's fields, and all other functions derive from it: `gaussian_prior`
for filters that keep one Gaussian, `sample_prior` for particles and for the true start.
"""

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


def sample_prior(problem: Problem, key: Array, count: int | None = None) -> Array:
    """Draws one state (nx,) from the prior or, with a `count`, that many (nx, count)."""
    shape = () if count is None else (count,)
    modes = prior_mixture(problem)
    normals = standard_normal(key, (modes.means.shape[1], *shape))
    if problem.prior_modes is None:
        means = modes.means[0] if count is None else modes.means[0][:, None]
    else:
        # The normals use the key's counters from 0 on, so the choice has a stream of its own.
        mode_key = jax.random.fold_in(key, MODE_STREAM)
        chosen = jax.random.categorical(mode_key, modes.log_weights, shape=shape)
        means = modes.means[chosen].T
    return means + psd_factor(covariance(modes.roots[0]))[0] @ normals
