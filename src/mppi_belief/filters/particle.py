"""Bootstrap particle filter (Gordon, Salmond and Smith 1993) with log-weights.

    x^j ~ p(x_{k+1} | x_k^j, u_k),    log w^j += log N(y; c(x^j), R_s(x^j))

R_s is taken at each particle, so that noise that depends on the state informs too. Systematic
resampling (Kitagawa 1996) where the effective sample size falls below a part of the particles.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ..belief import prior
from ..discretise import euler_step, measurement_cov
from ..linalg import log_det_spd, psd_factor, quadratic_form, spd_inverse, symmetrise
from ..noise import standard_normal
from ..problem import Problem
from ..pytree import number, size, struct


class ParticleBelief(NamedTuple):
    """Particles (nx, K) with normalised log-weights (K,), and their mean (nx,) and covariance (nx, nx)."""

    mean: Array
    cov: Array
    particles: Array
    log_weights: Array


@struct
class ParticleFilter:
    """`resample_below` is the part of K under which the effective sample size brings on resampling."""

    n_particles: int = size(50)
    resample_below: float = number(0.5, ge=0, le=1)

    def init(self, problem: Problem, key: Array) -> ParticleBelief:
        """Draws of the prior, equally weighted."""
        mean, cov = prior(problem)
        normals = standard_normal(key, (len(mean), self.n_particles))
        return summarised(mean[:, None] + psd_factor(cov)[0] @ normals, jnp.zeros(self.n_particles))

    def update(self, problem: Problem, belief: ParticleBelief, u: Array, y: Array, key: Array) -> ParticleBelief:
        """Move every particle, weigh it by the measurement, resample where needed."""
        system, dt = problem.system, problem.dt
        noise_key, resampling_key = jax.random.split(key)
        normals = standard_normal(noise_key, (system.H.shape[1], self.n_particles))
        moved = jax.vmap(lambda x: euler_step(system, x, u, dt), in_axes=-1, out_axes=-1)(belief.particles)
        moved = moved + system.H @ normals * jnp.sqrt(dt)
        log_weights = belief.log_weights + jax.vmap(lambda x: log_likelihood(problem, x, y), in_axes=-1)(moved)
        weighed = summarised(moved, log_weights)
        chosen = systematic(weighed.log_weights, resampling_key)
        resampled = weighed._replace(
            particles=moved[:, chosen], log_weights=jnp.full(self.n_particles, -jnp.log(self.n_particles))
        )
        few = 1.0 / jnp.sum(jnp.exp(2 * weighed.log_weights)) < self.resample_below * self.n_particles
        return jax.tree.map(lambda yes, no: jnp.where(few, yes, no), resampled, weighed)


def log_likelihood(problem: Problem, x: Array, y: Array) -> Array:
    """log N(y; c(x), R_s(x)) () up to a constant; finite however far off y is."""
    R_s = measurement_cov(problem.system, x, problem.dt)
    return -0.5 * (quadratic_form(spd_inverse(R_s), y - problem.system.c(x)) + log_det_spd(R_s))


def summarised(particles: Array, log_weights: Array) -> ParticleBelief:
    """The belief with its weights normalised; equal weights where none is finite."""
    usable = jnp.isfinite(log_weights)
    log_weights = jnp.where(usable.any(), jnp.where(usable, log_weights, -jnp.inf), 0.0)
    log_weights = jax.nn.log_softmax(log_weights)
    w = jnp.exp(log_weights)
    mean = particles @ w
    offsets = particles - mean[:, None]
    return ParticleBelief(mean, symmetrise((offsets * w) @ offsets.T), particles, log_weights)


def systematic(log_weights: Array, key: Array) -> Array:
    """Indices (K,) of survivors: one uniform draw, K equally spaced points on the cumulated weights."""
    n = log_weights.shape[0]
    points = (jnp.arange(n) + jax.random.uniform(key)) / n
    cumulated = jnp.cumsum(jnp.exp(log_weights))
    return jnp.minimum(jnp.searchsorted(cumulated / cumulated[-1], points), n - 1)
