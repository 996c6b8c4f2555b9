"""Bootstrap particle filter (Gordon, Salmond and Smith 1993) with log-weights.

    x^j ~ p(x_{k+1} | x_k^j, u_k),    log w^j += log N(y; c(x^j), R_s)

R_s is taken at each particle (`noise_at: particle`) or at their mean (`mean`, as in the extended
Kalman filter). The former is exact: noise that depends on the state informs, too. But where the
noise is small only near one place, a few particles away from the true state prefer those still
farther away, which explain any measurement by their noise: with the exact weights 50 particles lose
the light-dark vehicle in some trials out of a hundred, with R_s at the mean hardly ever.
Systematic resampling (Kitagawa 1996) follows where the effective sample size is low.
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
    """Moves K particles by the dynamics and weighs them by the measurements."""

    n_particles: int = size(default=50)  # K
    resample_below: float = number(default=0.5, ge=0, le=1)  # of K: the least effective size
    noise_at: str = choice("particle", "mean", default="particle")  # where R_s is taken

    def init(self, problem: Problem, key: Array) -> ParticleBelief:
        """Draws the particles from the prior, with equal weights."""
        particles = sample_prior(problem, key, self.n_particles)
        return weighted_particles(particles, jnp.zeros(self.n_particles))

    def update(
        self, problem: Problem, belief: ParticleBelief, u: Array, y: Array, key: Array
    ) -> ParticleBelief:
        """Moves every particle, weighs it by the measurement, resamples where needed."""
        noise_key, resampling_key = jax.random.split(key)
        moved = self._moved_particles(problem, belief.particles, u, noise_key)
        log_likelihoods = self._log_likelihoods(problem, belief, moved, y)
        weighted = weighted_particles(moved, belief.log_weights + log_likelihoods)

        # Both outcomes are computed, since the choice between them is traced.
        survivors = systematic_resampling(weighted.log_weights, resampling_key)
        resampled = weighted._replace(
            particles=moved[:, survivors],
            log_weights=jnp.full(self.n_particles, -jnp.log(self.n_particles)),
        )
        sample_size = 1.0 / jnp.sum(jnp.exp(2 * weighted.log_weights))
        is_low = sample_size < self.resample_below * self.n_particles
        return jax.tree.map(lambda new, old: jnp.where(is_low, new, old), resampled, weighted)

    def _moved_particles(self, problem: Problem, particles: Array, u: Array, key: Array) -> Array:
        """Returns the particles (nx, K) one step later, each with its own process noise."""
        system = problem.system
        normals = standard_normal(key, (system.H.shape[1], self.n_particles))
        step = jax.vmap(lambda x: euler_step(system, x, u, problem.dt), in_axes=-1, out_axes=-1)
        return step(particles) + system.H @ normals * jnp.sqrt(problem.dt)

    def _log_likelihoods(
        self, problem: Problem, belief: ParticleBelief, moved: Array, y: Array
    ) -> Array:
        """Returns the log-likelihood of y (ny,) for each moved particle (K,)."""
        if self.noise_at == "particle":
            return jax.vmap(lambda x: measurement_log_density(problem, x, x, y), in_axes=-1)(moved)
        mean = moved @ jnp.exp(belief.log_weights)
        return jax.vmap(lambda x: measurement_log_density(problem, x, mean, y), in_axes=-1)(moved)


def measurement_log_density(problem: Problem, x: Array, noise_state: Array, y: Array) -> Array:
    """Returns log N(y; c(x), R_s(noise_state)) () up to a constant, for x and noise_state (nx,).

    It is finite however far y (ny,) is from c(x).
    """
    R_s = measurement_cov(problem, noise_state)
    innovation = measurement_difference(problem.system, y, problem.system.c(x))
    return -0.5 * (quadratic_form(spd_inverse(R_s), innovation) + log_det_spd(R_s))


def systematic_resampling(log_weights: Array, key: Array) -> Array:
    """Returns the indices (K,) of surviving particles.

    One uniform draw places K equally spaced points on the cumulated weights.
    """
    n = log_weights.shape[0]
    points = (jnp.arange(n) + jax.random.uniform(key)) / n
    cumulated = jnp.cumsum(jnp.exp(log_weights))
    return jnp.minimum(jnp.searchsorted(cumulated / cumulated[-1], points), n - 1)
