"""What every filter in conf/filter must do: start at the prior, heed measurements that wrap."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import mppi_belief as mb
from cli_helpers import CONF, compose
from helpers import Feedback, assert_mean, light_dark_problem, quick_jit
from mppi_belief.problem import Correction, GaussianFilter
from mppi_belief.trial import build
from system_helpers import beacons, platform_problem

KEY = jax.random.key(0)
OPTIONS = sorted(path.stem for path in CONF.glob("filter/*.yaml"))
MODES = np.array([[0.3, 1.5, 0, 0], [0.0, -1.0, 0.2, 0]])
WEIGHTS = np.array([3.0, 1.0])
PRIOR_STD = np.array([0.2, 0.3, 0.05, 0.1])
PRIORS: dict[str, dict[str, Any]] = {
    "one Gaussian": {},
    "modes": {"prior_modes": MODES},
    "weighted modes": {"prior_modes": MODES, "prior_weights": WEIGHTS},
}


def configured(option: str) -> mb.Filter:
    """Returns the filter that a yaml of conf/filter describes."""
    return build(compose(f"filter={option}", "system=two_lanes")).filter


def moments(prior: dict[str, Any], mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns mean and covariance of a prior, by their definitions."""
    modes = prior.get("prior_modes", np.zeros((1, 4)))
    weights = prior.get("prior_weights", np.ones(len(modes)))
    weights = weights / weights.sum()
    centre = weights @ modes
    spread = np.einsum("m,mi,mj->ij", weights, modes - centre, modes - centre)
    return mean + centre, np.diag(PRIOR_STD**2) + spread


@pytest.mark.parametrize("prior", PRIORS)
@pytest.mark.parametrize("option", OPTIONS)
def test_a_filter_starts_with_the_mean_and_the_covariance_of_the_prior(option, prior, x64):
    filter = configured(option)
    problem = light_dark_problem(prior_std=PRIOR_STD, **PRIORS[prior])
    mean, cov = moments(PRIORS[prior], np.asarray(problem.prior_mean))
    if not isinstance(filter, mb.ParticleFilter):
        first = filter.init(problem, KEY)
        np.testing.assert_allclose(first.mean, mean, rtol=1e-12)
        np.testing.assert_allclose(first.cov, cov, atol=1e-12)
        return
    # Particles are draws, and their sample covariance is short by one part in K.
    start = quick_jit(jax.vmap(lambda key: filter.init(problem, key)[:2]))
    means, covs = start(jax.random.split(KEY, 2000))
    assert_mean(means, mean)
    assert_mean(np.asarray(covs), cov * (1 - 1 / filter.n_particles))


@pytest.mark.parametrize("turns", [-1, 2])
@pytest.mark.parametrize("option", OPTIONS)
def test_a_measured_angle_may_be_any_number_of_turns_away(option, turns, x64):
    """Also for the covariance of the innovation, which two modes and their weights depend on."""
    filter = configured(option)
    cost = mb.GoalObstacleCost([0] * 4, [1] * 4, [1] * 4, [1] * 2)
    modes = [[0.0, 0.0, 0.1, 0.0], [0.0, 0.0, -0.1, 0.0]]
    problem = mb.Problem(
        beacons(), cost, [0.5, -0.5, 3.1, 1.0], [0.3, 0.3, 0.1, 0.2], 0.1, 5, prior_modes=modes
    )
    update = quick_jit(filter.update)
    first = filter.init(problem, KEY)
    y = problem.system.c(jnp.asarray(problem.prior_mean)) + 0.01
    usual = update(problem, first, jnp.zeros(2), y, KEY)
    turned = update(problem, first, jnp.zeros(2), y.at[1::2].add(2 * np.pi * turns), KEY)
    assert np.abs(usual.mean - first.mean).max() > 1e-3
    for a, b in zip(jax.tree.leaves(turned), jax.tree.leaves(usual), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


@pytest.mark.parametrize("option", OPTIONS)
def test_a_filter_that_knows_its_innovations_uses_them_in_its_update(option, light_dark, x64):
    filter = configured(option)
    if not isinstance(filter, GaussianFilter):
        return
    u = jnp.array([1.0, -2.0])
    y = jnp.array([1.3, 0.8])
    first = filter.init(light_dark, KEY)
    predicted = filter.predict(light_dark, first, u)
    correction = filter.correct(light_dark, predicted, y)
    after = filter.update(light_dark, first, u, y, KEY)
    assert isinstance(correction, Correction)
    np.testing.assert_allclose(correction.posterior.mean, after.mean, rtol=1e-12)
    np.testing.assert_allclose(correction.posterior.cov, after.cov, rtol=1e-12)
    np.testing.assert_allclose(correction.innovation, y - predicted.mean[:2], atol=1e-9)
    noise = np.asarray(light_dark.system.sigma_o(predicted.mean)) ** 2
    np.testing.assert_allclose(correction.innovation_cov, predicted.cov[:2, :2] + noise, atol=1e-12)


def test_filters_agree_on_the_innovations_of_a_sensor_that_follows_the_belief(x64):
    """Both filters have the same NIS in a linear system, with the sensor as it was aimed."""
    problem = platform_problem(noise_convention="sample", limit=5.0)
    trial = quick_jit(mb.simulate_trial)(problem, mb.EKF(), Feedback(0.2), 3, 0)
    extended, unscented = (
        quick_jit(mb.consistency)(problem, filter, trial) for filter in (mb.EKF(), mb.UKF())
    )
    np.testing.assert_allclose(unscented.nis, extended.nis, rtol=1e-9)


@mb.struct
class Compass:
    """Turns on the spot and reads its heading modulo a turn, in (-pi, pi]."""

    heading_error: float = mb.number(default=0.05, gt=0)  # rad

    @property
    def H(self) -> Array:
        return jnp.array([[0.05]])

    def f(self, x: Array) -> Array:
        return jnp.zeros(1)

    def G(self, x: Array) -> Array:
        return jnp.ones((1, 1))

    def c(self, x: Array) -> Array:
        return jnp.arctan2(jnp.sin(x), jnp.cos(x))

    def difference(self, y: Array, predicted: Array) -> Array:
        offset = y - predicted
        return offset - 2 * jnp.pi * jnp.round(offset / (2 * jnp.pi))

    def sigma_o(self, x: Array) -> Array:
        return jnp.full((1, 1), self.heading_error)


@pytest.mark.parametrize("heading", [3.10, 3.18, 3.10 - 2 * np.pi, 3.18 - 2 * np.pi])
def test_the_bank_weighs_two_headings_on_both_sides_of_the_jump_by_bayes_rule(heading, x64):
    """One mode heads a little north of west, the other, whose reading is negative, south of it."""
    cost = mb.GoalObstacleCost([3.14], [1.0], [1.0], [1.0], 0, 1)
    modes = np.array([[-0.04], [0.04]])
    problem = mb.Problem(Compass(), cost, [3.14], [0.02], 0.1, 5, prior_modes=modes)
    bank = mb.MixtureFilter()
    first = bank.init(problem, KEY)
    after = quick_jit(bank.update)(problem, first, jnp.zeros(1), jnp.array([heading]), KEY)
    variance = 0.02**2 + 0.05**2 * 0.1 + 0.05**2
    offsets = heading % (2 * np.pi) - np.array([3.10, 3.18])
    likelihoods = np.exp(-0.5 * offsets**2 / variance)
    np.testing.assert_allclose(after.weights, likelihoods / likelihoods.sum(), rtol=1e-9)
