"""Bootstrap particle filter (Gordon, Salmond and Smith 1993) with log-weights.

    x^j ~ p(x_{k+1} | x_k^j, u_k),    log w^j += log N(y; c(x^j), R_s)

R_s is that of each particle (`noise_at: particle`, exact: noise that depends on the state informs too) or that of
their mean (`mean`, as the extended Kalman filter has it). Where the noise is small only near one place, a few
particles that are off prefer those farther off, which explain any measurement by their noise: with the exact
weights 50 particles lose the light-dark vehicle in some trials out of a hundred, with R_s at the mean hardly ever.
Systematic resampling (Kitagawa 1996) where the effective sample size falls below a part of the particles.
"""

import jax
import jax.numpy as jnp
from jax import Array

from ..belief.particles import ParticleBelief, weighted_particles
from ..belief.prior import sample_prior
from ..discretise import euler_step, measurement_cov, measurement_difference
from ..numerics.linalg import log_det_spd, quadratic_form, spd_inverse
from ..numerics.normals import standard_normal
from ..problem import Problem
from ..structs import choice, number, size, struct


@struct
class ParticleFilter:
    """`resample_below` is the part of K under which the effective sample size brings on resampling; `noise_at`
    says where R_s is taken, "particle" or "mean"."""

    n_particles: int = size(50)
    resample_below: float = number(0.5, ge=0, le=1)
    noise_at: str = choice("particle", "mean")

    def init(self, problem: Problem, key: Array) -> ParticleBelief:
        """Draws the particles from the prior, with equal weights."""
        particles = sample_prior(problem, key, self.n_particles)
        return weighted_particles(particles, jnp.zeros(self.n_particles))

    def update(
        self, problem: Problem, belief: ParticleBelief, u: Array, y: Array, key: Array
    ) -> ParticleBelief:
        """Move every particle, weigh it by the measurement, resample where needed."""
        system, dt = problem.system, problem.dt
        noise_key, resampling_key = jax.random.split(key)
        normals = standard_normal(noise_key, (system.H.shape[1], self.n_particles))
        moved = jax.vmap(lambda x: euler_step(system, x, u, dt), in_axes=-1, out_axes=-1)(
            belief.particles
        )
        moved = moved + system.H @ normals * jnp.sqrt(dt)
        weighed = weighted_particles(
            moved, belief.log_weights + self._log_likelihoods(problem, belief, moved, y)
        )
        chosen = systematic(weighed.log_weights, resampling_key)
        resampled = weighed._replace(
            particles=moved[:, chosen],
            log_weights=jnp.full(self.n_particles, -jnp.log(self.n_particles)),
        )
        few = (
            1.0 / jnp.sum(jnp.exp(2 * weighed.log_weights)) < self.resample_below * self.n_particles
        )
        return jax.tree.map(lambda yes, no: jnp.where(few, yes, no), resampled, weighed)

    def _log_likelihoods(
        self, problem: Problem, belief: ParticleBelief, moved: Array, y: Array
    ) -> Array:
        """Of each moved particle (K,)."""
        if self.noise_at == "particle":
            return jax.vmap(lambda x: log_likelihood(problem, x, x, y), in_axes=-1)(moved)
        mean = moved @ jnp.exp(belief.log_weights)
        return jax.vmap(lambda x: log_likelihood(problem, x, mean, y), in_axes=-1)(moved)


def log_likelihood(problem: Problem, x: Array, at: Array, y: Array) -> Array:
    """log N(y; c(x), R_s(at)) () up to a constant, for states x and at (nx,); finite however far off y is."""
    R_s = measurement_cov(problem, at)
    off = measurement_difference(problem.system, y, problem.system.c(x))
    return -0.5 * (quadratic_form(spd_inverse(R_s), off) + log_det_spd(R_s))


def systematic(log_weights: Array, key: Array) -> Array:
    """Indices (K,) of survivors: one uniform draw, K equally spaced points on the cumulated weights."""
    n = log_weights.shape[0]
    points = (jnp.arange(n) + jax.random.uniform(key)) / n
    cumulated = jnp.cumsum(jnp.exp(log_weights))
    return jnp.minimum(jnp.searchsorted(cumulated / cumulated[-1], points), n - 1)
