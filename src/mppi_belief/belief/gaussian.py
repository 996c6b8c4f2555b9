"""What a belief is: one Gaussian with a root of its covariance, or several.

Covariances are carried as roots, Sigma = root root', so that they stay semidefinite whatever is rounded.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array

from ..numerics.linalg import symmetrise
from ..numerics.square_root import pivoted_cholesky, tria


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
        """(nx, nx), see `mixture_covariance`."""
        return mixture_covariance(self.weights, self.means, covariance(self.roots))

    @property
    def root(self) -> Array:
        """A root (nx, nx) of it."""
        columns = jnp.concatenate([self.roots, (self.means - self.mean)[:, :, None]], axis=2)
        return tria(jnp.concatenate(list(columns * jnp.sqrt(self.weights)[:, None, None]), axis=1))


def covariance_root(belief: Any) -> Array:
    """A root (nx, nx) of a belief's covariance: its own, if it has one."""
    return (
        belief.root
        if isinstance(belief, RootBelief | MixtureBelief)
        else pivoted_cholesky(belief.cov)
    )


def covariance(root: Array) -> Array:
    """root root' for (..., nx, nx), semidefinite on its own scale whatever the root."""
    return symmetrise(root @ jnp.swapaxes(root, -1, -2))


def mixture_covariance(weights: Array, means: Array, covs: Array) -> Array:
    """sum_i w_i (Sigma_i + (mu_i - mu)(mu_i - mu)') (nx, nx) for weights (m,), means (m, nx), covs (m, nx, nx)."""
    off = means - weights @ means
    return symmetrise(jnp.tensordot(weights, covs + off[:, :, None] * off[:, None, :], axes=1))
