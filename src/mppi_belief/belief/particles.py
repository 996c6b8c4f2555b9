"""Weighted particles as a belief."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ..numerics.linalg import symmetrise


class ParticleBelief(NamedTuple):
    """Holds K weighted particles and their first two moments."""

    mean: Array  # (nx,)
    cov: Array  # (nx, nx)
    particles: Array  # (nx, K)
    log_weights: Array  # (K,), normalised


def weighted_particles(particles: Array, log_weights: Array) -> ParticleBelief:
    """Returns the belief of particles (nx, K) with log-weights (K,), which are normalised.

    Weights that are not finite count as zero; where none is finite, all weights are equal.
    """
    usable = jnp.isfinite(log_weights)
    log_weights = jnp.where(usable.any(), jnp.where(usable, log_weights, -jnp.inf), 0.0)
    log_weights = jax.nn.log_softmax(log_weights)
    w = jnp.exp(log_weights)
    mean = particles @ w
    offsets = particles - mean[:, None]
    return ParticleBelief(mean, symmetrise((offsets * w) @ offsets.T), particles, log_weights)
