"""Weighted particles as a belief."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ..numerics.linalg import symmetrise


class ParticleBelief(NamedTuple):
    """Particles (nx, K) with normalised log-weights (K,), and their mean (nx,) and covariance (nx, nx)."""

    mean: Array
    cov: Array
    particles: Array
    log_weights: Array


def weighted_particles(particles: Array, log_weights: Array) -> ParticleBelief:
    """The belief with its weights normalised; equal weights where none is finite."""
    usable = jnp.isfinite(log_weights)
    log_weights = jnp.where(usable.any(), jnp.where(usable, log_weights, -jnp.inf), 0.0)
    log_weights = jax.nn.log_softmax(log_weights)
    w = jnp.exp(log_weights)
    mean = particles @ w
    offsets = particles - mean[:, None]
    return ParticleBelief(mean, symmetrise((offsets * w) @ offsets.T), particles, log_weights)
