"""PIPF: CE-MPPI from one certain particle, and the two ways to combine many."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb
from helpers import light_dark_problem, quick_jit
from mppi_belief.belief.particles import ParticleBelief, weighted_particles

KEY = jax.random.key(3)
PLAN = 0.3 * jnp.ones((10, 2))
STD = 1.5
TEMPERATURE = 2.0
SHARED = {"horizon": 10, "temperature": TEMPERATURE, "sampler": mb.NominalSampler(STD)}
COMBINATIONS = {"average": mb.AverageOfParticles(), "pooled": mb.PooledPaths()}


def particles(*states: list[float], weights: list[float] | None = None) -> ParticleBelief:
    log_weights = jnp.log(jnp.asarray(weights)) if weights else jnp.zeros(len(states))
    return weighted_particles(jnp.asarray(states, dtype=float).T, log_weights)


@quick_jit
def act(problem: mb.Problem, controller: mb.Controller, belief) -> jax.Array:
    return controller.act(problem, belief, PLAN, KEY)[0]


@quick_jit
def rate(problem: mb.Problem, x: jax.Array) -> jax.Array:
    return problem.cost.base(x) + problem.penalty(x)


@pytest.mark.parametrize(("combine", "points"), [("average", 1), ("pooled", 1), ("pooled", 3)])
def test_one_certain_particle_gives_the_control_of_ce_mppi(combine, points, light_dark, x64):
    state = [2.0, 0.5, 1.0, -0.2]
    shared = SHARED | {"path_cost": mb.CertaintyEquivalent(points_per_step=points)}
    pipf = mb.PIPF(n_samples=64, combination=COMBINATIONS[combine], **shared)
    ce = mb.MPPI(n_samples=64, **shared)
    belief = mb.Belief(jnp.asarray(state), jnp.zeros((4, 4)))
    np.testing.assert_allclose(
        act(light_dark, pipf, particles(state)), act(light_dark, ce, belief), rtol=1e-12
    )


def increments_and_costs(problem: mb.Problem, belief: ParticleBelief, n_samples: int):
    """Path costs (K, L) and first increments (K, L, nu), by a plain loop over the paths the
    controller draws.
    """
    count = belief.particles.shape[1] * n_samples
    plan = np.asarray(PLAN)
    R = np.asarray(problem.cost.R)
    deltas = STD * np.asarray(jax.random.normal(KEY, (10, 2, count)))
    costs = np.zeros(count)
    for i in range(count):
        x = np.asarray(belief.particles[:, i // n_samples])
        for k in range(10):
            u = plan[k] + deltas[k, :, i]
            x = x + problem.dt * np.concatenate([x[2:], u])
            costs[i] += problem.dt * (float(rate(problem, x)) + plan[k] @ R @ deltas[k, :, i])
        costs[i] += float(problem.cost.terminal(jnp.asarray(x)))
    return costs.reshape(-1, n_samples), deltas[0].T.reshape(-1, n_samples, 2)


@pytest.mark.parametrize("combine", ["average", "pooled"])
def test_particles_are_combined_as_documented(combine, light_dark, x64):
    belief = particles(
        [1.0, 1.0, 0, 0], [2.0, 0.2, 1, 0], [4.0, -1.0, 0, 0.5], weights=[0.2, 0.5, 0.3]
    )
    costs, deltas = increments_and_costs(light_dark, belief, n_samples=8)
    likelihoods = np.exp(-(costs - costs.min()) / TEMPERATURE)
    posterior = np.exp(np.asarray(belief.log_weights))[:, None]
    if combine == "average":
        weights = posterior * likelihoods / likelihoods.sum(axis=1, keepdims=True)
    else:
        weights = posterior * likelihoods / np.sum(posterior * likelihoods)
    expected = np.asarray(PLAN[0]) + np.einsum("jl,jli->i", weights, deltas)
    computed = act(
        light_dark, mb.PIPF(n_samples=8, combination=COMBINATIONS[combine], **SHARED), belief
    )
    np.testing.assert_allclose(computed, expected, rtol=1e-9)


def test_the_two_ways_to_combine_differ_where_particles_do(light_dark):
    belief = particles([1.0, 1.0, 0, 0], [4.0, -1.0, 0, 0.5])
    controls = [
        act(light_dark, mb.PIPF(n_samples=64, combination=way, **SHARED), belief)
        for way in COMBINATIONS.values()
    ]
    assert np.linalg.norm(controls[0] - controls[1]) > 0.1


@pytest.mark.parametrize("sampler", [mb.InnovationSampler(), mb.LaplaceSampler(), "nominal"])
def test_a_sampler_that_plans_from_one_gaussian_is_refused(sampler):
    with pytest.raises(ValueError, match="NominalSampler"):
        mb.PIPF(sampler=sampler)


def test_a_filter_without_particles_is_refused():
    problem = light_dark_problem(steps=2)
    with pytest.raises(TypeError, match="filter=particle"):
        mb.simulate_trial(problem, mb.EKF(), mb.PIPF(n_samples=4, horizon=3), 0, 0)
