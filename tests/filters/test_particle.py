"""The bootstrap particle filter: Kalman's answers, honest weights, fair resampling."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

import mppi_belief as mb
from helpers import assert_mean, light_dark_problem, quick_jit
from linear_system import random_problem
from mppi_belief.belief.particles import ParticleBelief, weighted_particles
from mppi_belief.discretise import euler_step
from mppi_belief.filters.particle import measurement_log_density, systematic_resampling

CONTROLS = jnp.array([[0.5, -0.2], [0.1, 0.3], [-0.4, 0.0], [0.2, 0.2]])
SURPRISES = jnp.array(
    [[0.2], [-0.1], [0.15], [0.1]]
)  # what a measurement is off by, of the order of its noise


def measurements(problem: mb.Problem) -> jax.Array:
    """Returns the measurements of a vehicle without noise, plus given surprises."""

    def step(x, inputs):
        x = euler_step(problem.system, x, inputs[0], problem.dt)
        return x, problem.system.c(x) + inputs[1]

    return jax.lax.scan(step, jnp.asarray(problem.prior_mean, float), (CONTROLS, SURPRISES))[1]


def run(problem: mb.Problem, filter: mb.Filter, key):
    def step(belief, inputs):
        k, u, y = inputs
        return filter.update(problem, belief, u, y, jax.random.fold_in(key, k)), None

    steps = (jnp.arange(len(CONTROLS)), CONTROLS, measurements(problem))
    return jax.lax.scan(step, filter.init(problem, key), steps)[0]


@quick_jit
def update(
    problem: mb.Problem, filter: mb.ParticleFilter, belief: ParticleBelief, y, key
) -> ParticleBelief:
    return filter.update(problem, belief, jnp.zeros(2), y, key)


@quick_jit
def first_update(problem: mb.Problem, filter: mb.ParticleFilter, y, key) -> ParticleBelief:
    return filter.update(problem, filter.init(problem, key), jnp.zeros(2), y, key)


def test_mean_and_covariance_are_kalmans_on_a_linear_system(x64, rng):
    problem = random_problem(rng)
    exact = quick_jit(lambda key: run(problem, mb.EKF(), key))(jax.random.key(0))
    keys = jax.random.split(jax.random.key(2), 40)
    particle_belief = quick_jit(jax.vmap(lambda key: run(problem, mb.ParticleFilter(8000), key)))(
        keys
    )
    # the bias of a particle estimate is O(1/K), far below the standard error of 40 of them
    assert_mean(particle_belief.mean, exact.mean)
    assert_mean(particle_belief.cov, exact.cov)


def test_likelihood_is_the_normal_density_with_the_noise_of_the_place_it_is_told(x64):
    problem = light_dark_problem()
    likelihood = quick_jit(measurement_log_density)
    y = jnp.array([2.0, 0.3])
    for x in (jnp.array([1.0, 0, 0, 0]), jnp.array([5.0, 0.1, 0, 0]), jnp.array([7.0, 1.0, 0, 0])):
        for noise_state in (x, jnp.array([6.0, 0, 0, 0])):
            sigma = abs(float(noise_state[0]) - 5) / np.sqrt(2) + 0.1
            expected = stats.multivariate_normal(x[:2], sigma**2 * np.eye(2)).logpdf(y) + np.log(
                2 * np.pi
            )
            np.testing.assert_allclose(likelihood(problem, x, noise_state, y), expected, rtol=1e-10)


def lost_in_the_light(noise_at: str) -> tuple[np.ndarray, np.ndarray]:
    """Returns positions p_x and weights of particles from 5.3 to 6.7 m, measured at 5 m."""
    problem = light_dark_problem()
    filter = mb.ParticleFilter(50, resample_below=0.0, noise_at=noise_at)
    particles = jnp.zeros((4, 50)).at[0].set(jnp.linspace(5.3, 6.7, 50))
    belief = weighted_particles(particles, jnp.zeros(50))
    after = update(problem, filter, belief, jnp.array([5.0, 0.0]), jax.random.key(0))
    return np.asarray(after.particles[0]), np.exp(after.log_weights)


def test_with_the_noise_at_each_particle_those_farther_off_explain_the_measurement():
    """N(5; p, sigma(p)) grows with |p - 5| as long as sigma grows faster than the distance."""
    where, weight = lost_in_the_light("particle")
    sigma = np.abs(where - 5) / np.sqrt(2) + 0.1
    expected = np.exp(-0.5 * ((where - 5) / sigma) ** 2) / sigma**2
    np.testing.assert_allclose(weight, expected / expected.sum(), rtol=1e-3)


def test_with_the_noise_at_the_mean_the_nearest_particles_weigh_most():
    where, weight = lost_in_the_light("mean")
    sigma = abs(where.mean() - 5) / np.sqrt(2) + 0.1
    expected = np.exp(-0.5 * ((where - 5) / sigma) ** 2)
    np.testing.assert_allclose(weight, expected / expected.sum(), rtol=1e-3)
    assert np.all(np.diff(weight[np.argsort(where)]) < 0)


@pytest.mark.parametrize("y", [[1e6, -1e6], [1e18, 0.0], [3e38, 0.0]])
def test_a_measurement_far_off_leaves_honest_weights(y):
    belief = first_update(
        light_dark_problem(), mb.ParticleFilter(50), jnp.array(y), jax.random.key(0)
    )
    for part in belief:
        assert not np.isnan(part).any()
    np.testing.assert_allclose(np.exp(belief.log_weights).sum(), 1.0, rtol=1e-5)
    assert np.all(np.linalg.eigvalsh(belief.cov) >= -1e-5)


def test_no_usable_weight_means_equal_weights():
    particles = jnp.arange(8.0).reshape(2, 4)
    belief = weighted_particles(particles, jnp.array([-jnp.inf, jnp.nan, -jnp.inf, -jnp.inf]))
    np.testing.assert_allclose(np.exp(belief.log_weights), 0.25, rtol=1e-6)
    np.testing.assert_allclose(belief.mean, particles.mean(axis=1), rtol=1e-6)


quick_systematic = quick_jit(systematic_resampling)  # compiled once for each size


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.sampled_from([2, 3, 8, 23, 40]).flatmap(
        lambda n: st.lists(st.floats(-8, 8), min_size=n, max_size=n)
    ),
    st.integers(0, 1000),
)
def test_systematic_resampling_copies_each_particle_as_often_as_it_weighs(scores, seed):
    weights = np.exp(scores) / np.sum(np.exp(scores))
    chosen = np.asarray(quick_systematic(np.log(weights), jax.random.key(seed)))
    counts = np.bincount(chosen, minlength=len(weights))
    expected = len(weights) * weights
    assert counts.sum() == len(weights)
    assert np.all(
        np.abs(counts - expected) < 1 + 1e-4
    )  # floor or ceiling, but for float32 in the cumulated sum


@pytest.mark.parametrize(("below", "resampled"), [(0.0, False), (1.0, True)])
def test_resampling_happens_below_the_threshold_only(below, resampled):
    filter = mb.ParticleFilter(50, resample_below=below)
    belief = first_update(light_dark_problem(), filter, jnp.array([1.1, 0.9]), jax.random.key(2))
    assert np.allclose(belief.log_weights, -np.log(50), atol=1e-5) == resampled
