"""What a belief is: one Gaussian with a root of its covariance, or several; and the prior, which is the first.

Covariances are carried as roots, Sigma = root root', so that they stay semidefinite whatever is rounded.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ..numerics.linalg import semidefinite_root, symmetrise, triangular_root
from ..problem import Belief, Problem

LAST = 2**31 - 1  # what a key is folded with to be told from those folded with counts


class RootBelief(NamedTuple):
    """A Gaussian belief N(mean, root root'): mean (nx,), root (nx, nx)."""

    mean: Array
    root: Array

    @property
    def cov(self) -> Array:
        """The covariance (nx, nx)."""
        return covariance(self.root)


class MixtureBelief(NamedTuple):
    """A mixture of m Gaussians N(means_i, roots_i roots_i'): means (m, nx), roots (m, nx, nx), normalised log_weights
    (m,). `mean` and `cov` are those of the whole."""

    means: Array
    roots: Array
    log_weights: Array

    @property
    def weights(self) -> Array:
        """(m,), adding up to one."""
        return jnp.exp(self.log_weights)

    @property
    def mean(self) -> Array:
        """sum_i w_i mu_i (nx,)."""
        return self.weights @ self.means

    @property
    def cov(self) -> Array:
        """(nx, nx), see `mixture_cov`."""
        return mixture_cov(self.weights, self.means, covariance(self.roots))

    @property
    def root(self) -> Array:
        """A root (nx, nx) of it."""
        columns = jnp.concatenate([self.roots, (self.means - self.mean)[:, :, None]], axis=2)
        return triangular_root(
            jnp.concatenate(list(columns * jnp.sqrt(self.weights)[:, None, None]), axis=1)
        )


def prior(problem: Problem) -> Belief:
    """The belief before any measurement, with the mean and the covariance of all modes if there are several."""
    if problem.prior_modes is not None:
        whole = prior_mixture(problem)
        return Belief(whole.mean, whole.cov)
    return Belief(jnp.asarray(problem.prior_mean), jnp.diag(jnp.asarray(problem.prior_std) ** 2))


def prior_mixture(problem: Problem) -> MixtureBelief:
    """The same with each mode by itself; one where the prior is one Gaussian."""
    mean, root = jnp.asarray(problem.prior_mean), jnp.diag(jnp.asarray(problem.prior_std))
    means = mean[None] if problem.prior_modes is None else mean + jnp.asarray(problem.prior_modes)
    equal = jnp.ones(len(means), means.dtype)
    weights = equal if problem.prior_weights is None else jnp.asarray(problem.prior_weights)
    roots = jnp.broadcast_to(root, (len(means), *root.shape))
    return MixtureBelief(means, roots, jnp.log(weights / jnp.sum(weights)))


def drawn_mode(problem: Problem, key: Array, shape: tuple[int, ...] = ()) -> Belief:
    """The modes of the prior that draws of it come from: means (*shape, nx), and the covariance (nx, nx) of
    each; of one Gaussian its mean (nx,), whatever the shape."""
    if problem.prior_modes is None:
        return prior(problem)
    modes = prior_mixture(problem)
    # a key of its own: the draws' normals count from 0 under the one that is given
    chosen = jax.random.categorical(jax.random.fold_in(key, LAST), modes.log_weights, shape=shape)
    return Belief(modes.means[chosen], covariance(modes.roots[0]))


def rooted(belief: Any) -> Array:
    """A root (nx, nx) of a belief's covariance: its own, if it has one."""
    return (
        belief.root
        if isinstance(belief, RootBelief | MixtureBelief)
        else semidefinite_root(belief.cov)
    )


def covariance(root: Array) -> Array:
    """root root' for (..., nx, nx), semidefinite on its own scale whatever the root."""
    return symmetrise(root @ jnp.swapaxes(root, -1, -2))


def mixture_cov(weights: Array, means: Array, covs: Array) -> Array:
    """sum_i w_i (Sigma_i + (mu_i - mu)(mu_i - mu)') (nx, nx) for weights (m,), means (m, nx), covs (m, nx, nx)."""
    off = means - weights @ means
    return symmetrise(jnp.tensordot(weights, covs + off[:, :, None] * off[:, None, :], axes=1))
