"""Beliefs as one Gaussian or a mixture of Gaussians, their covariances carried as square roots.

Sigma = root root' stays positive semidefinite whatever is rounded.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array

from ..numerics.linalg import symmetrise
from ..numerics.square_root import pivoted_cholesky, tria


class RootBelief(NamedTuple):
    """Holds a Gaussian belief N(mean, root root')."""

    mean: Array  # mu (nx,)
    root: Array  # (nx, nx), any square root of the covariance

    @property
    def cov(self) -> Array:
        """Returns the covariance Sigma (nx, nx)."""
        return covariance(self.root)


class MixtureBelief(NamedTuple):
    """Holds a mixture of m Gaussians, sum_i w_i N(means_i, roots_i roots_i')."""

    means: Array  # (m, nx), of the components
    roots: Array  # (m, nx, nx), square roots of the components' covariances
    log_weights: Array  # (m,), normalised

    @property
    def weights(self) -> Array:
        """Returns the weights w (m,), which add up to one."""
        return jnp.exp(self.log_weights)

    @property
    def mean(self) -> Array:
        """Returns the mean (nx,) of the mixture, sum_i w_i mu_i."""
        return self.weights @ self.means

    @property
    def cov(self) -> Array:
        """Returns the covariance (nx, nx) of the mixture."""
        return mixture_covariance(self.weights, self.means, covariance(self.roots))

    @property
    def root(self) -> Array:
        """Returns a square root (nx, nx) of the mixture's covariance."""
        offsets = (self.means - self.mean)[:, :, None]
        columns = jnp.concatenate([self.roots, offsets], axis=2)
        weighted = columns * jnp.sqrt(self.weights)[:, None, None]
        return tria(jnp.concatenate(list(weighted), axis=1))


def covariance_root(belief: Any) -> Array:
    """Returns a square root (nx, nx) of a belief's covariance: its own, if it carries one."""
    if isinstance(belief, RootBelief | MixtureBelief):
        return belief.root
    return pivoted_cholesky(belief.cov)


def covariance(root: Array) -> Array:
    """Returns root root' for (..., nx, nx), semidefinite on its own scale whatever the root."""
    return symmetrise(root @ jnp.swapaxes(root, -1, -2))


def mixture_covariance(weights: Array, means: Array, covs: Array) -> Array:
    """Returns sum_i w_i (Sigma_i + (mu_i - mu)(mu_i - mu)') (nx, nx).

    For weights (m,), means (m, nx) and covs (m, nx, nx) of the components.
    """
    offsets = means - weights @ means
    outer_products = offsets[:, :, None] * offsets[:, None, :]
    return symmetrise(jnp.tensordot(weights, covs + outer_products, axes=1))
