"""Theorem 1: its certificate, that it can fail, and the part outside the mean tangent space for any observation."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mppi_belief as mb
from helpers import float64, quick_jit, random_spd
from mppi_belief.matching.affine import outside_mean_tangent
from mppi_belief.numerics.quadrature import gaussian_nodes
from mppi_belief.verify.certificates import affine_observations as certificate


@pytest.fixture(scope="module")
def found():
    with float64():
        return certificate.certify(1)


at = quick_jit(outside_mean_tangent, static_argnums=0)


def check(made, start):
    """The check whose text starts so."""
    (one,) = [check for check in made if check.computed.startswith(start)]
    return one


def test_the_certificate_holds(found):
    assert found.holds, [check for check in found.checks if not check.holds]
    assert len(found.checks) == 10
    affine, cubic, sine, *_ = found.panels[0].lines
    assert max(affine.y) < 1e-20
    assert max(cubic.y) > 0.3
    assert max(sine.y) > 0.9


def test_an_observation_that_is_nearly_affine_is_caught(x64, monkeypatch):
    line = certificate._line
    monkeypatch.setattr(certificate, "_line", lambda A, b, x: line(A, b, x) + 1e-7 * jnp.sin(x[0]))
    part, slope = certificate._affine(np.random.default_rng(0))
    assert not part.holds
    assert not slope.holds


def test_the_closed_forms_tell_a_wrong_part(x64):
    mu = np.linspace(-1.9, 1.9, 6)
    cubic, sine = certificate.outside(
        [lambda x: x**3, jnp.sin], mu[:, None], np.array([[certificate.S**2]])
    )
    assert all(check.holds for check in certificate._closed_forms(mu, cubic, sine))
    wrong = cubic._replace(part=cubic.part + 1e-11)
    assert not check(certificate._closed_forms(mu, wrong, sine), "x³: largest").holds
    affine = sine._replace(part=0 * sine.part)
    assert not check(certificate._closed_forms(mu, cubic, affine), "sin x: least").holds


def test_an_affine_sensor_in_place_of_distance_and_bearing_is_caught(x64, monkeypatch):
    monkeypatch.setattr(certificate, "bearing", lambda x: 2 * x + 1)
    mu = np.zeros((2, 1))
    nothing = certificate.Found(np.zeros(2), mu[:, :, None], 4)
    assert not any(
        check.holds for check in certificate._nonlinear(np.random.default_rng(0), nothing, nothing)
    )


def test_a_filter_that_uses_the_scatter_is_caught(x64, monkeypatch):
    correct = certificate.correct

    def shrewd(problem, belief, y):
        after = correct(problem, belief, y).posterior
        cov = jnp.linalg.inv(jnp.linalg.inv(after.cov) + jnp.diag(jnp.array([1.0, 0, 0, 0])))
        return after._replace(root=jnp.linalg.cholesky(cov))

    monkeypatch.setattr(certificate, "correct", shrewd)
    level, ekf = certificate._noise_level(np.random.default_rng(0))
    assert level.holds
    assert not ekf.holds
    monkeypatch.setattr(certificate, "SLOPE", 0.7)
    monkeypatch.setattr(certificate, "light_dark", partial(light_dark, 0.6))
    assert not certificate._noise_level(np.random.default_rng(0))[0].holds


def light_dark(slope, convention, dt=0.1):
    system = certificate.LightDark(0.3, 5.0, slope, 0.1)
    cost = mb.GoalObstacleCost(jnp.zeros(4), jnp.ones(4), jnp.ones(4), jnp.ones(2))
    return mb.Problem(
        system, cost, jnp.zeros(4), jnp.ones(4), dt, steps=1, noise_convention=convention
    )


def test_the_fisher_information_is_the_variance_of_the_score(x64, rng):
    """Monte Carlo: the covariance of d log p(y | x) / dx, position and noise level together."""
    problem, x = light_dark(0.5**0.5, "sample"), jnp.array([3.0, 1.0, 0.2, 0.1])
    R = certificate.measurement_cov(problem, x)

    def log_density(x, y):
        cov = certificate.measurement_cov(problem, x)
        apart = y - problem.system.c(x)
        return -0.5 * (apart @ jnp.linalg.solve(cov, apart) + jnp.linalg.slogdet(cov)[1])

    y = np.asarray(problem.system.c(x)) + rng.normal(size=(40_000, 2)) * np.sqrt(np.diag(R))
    scores = np.asarray(quick_jit(jax.vmap(jax.grad(log_density), (None, 0)))(x, y))[:, 0]
    squares = scores**2
    told = float(
        sum(part[0, 0] for part in quick_jit(lambda x: certificate.information(problem, x))(x))
    )
    assert abs(squares.mean() - told) < 4.5 * squares.std() / np.sqrt(len(squares))
    assert told == pytest.approx(3 / float(R[0, 0]), rel=1e-12)


@quick_jit
def affine_part(A, b, mean, cov, points):
    """By nodes that are no rule at all."""
    return outside_mean_tangent(lambda x: A @ x + b, mean, cov, (points, jnp.full(50, 0.02)))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([(1, 1), (2, 8)]))
def test_an_affine_observation_leaves_nothing_on_any_nodes(seed, shape):
    rng, (ny, nx) = np.random.default_rng(seed), shape
    A = rng.normal(size=shape)
    with float64():
        part, slope = affine_part(
            A,
            rng.normal(size=ny),
            rng.normal(size=nx),
            random_spd(rng, nx),
            rng.normal(size=(50, nx)),
        )
        part, slope = float(part), np.asarray(slope)
    # 50 nodes: 200 operations, over |A| of at least 1e-3 but for a chance of 1e-3 squared
    assert part < (200 * 2.2e-16 * 1e4) ** 2
    np.testing.assert_allclose(slope, A, atol=1e-11)


def test_quadratics_in_two_dimensions_have_their_closed_form(x64):
    """c = p'p / 2 under N(mu, Sigma): A = mu', Var = mu' Sigma mu + tr(Sigma^2) / 2."""
    mean, cov = jnp.array([1.0, -0.4]), jnp.array([[0.5, 0.1], [0.1, 0.3]])
    part, slope = at(lambda x: 0.5 * (x @ x)[None], mean, cov)
    outside = 0.5 * jnp.trace(cov @ cov)
    assert part == pytest.approx(float(outside / (mean @ cov @ mean + outside)), rel=1e-10)
    np.testing.assert_allclose(slope, mean[None], rtol=1e-10)


def test_many_states_go_by_a_fixed_point_set(x64):
    mean, cov = jnp.full(7, 0.5), 0.09 * jnp.eye(7)
    part, slope = at(lambda x: x[:1] ** 2, mean, cov)
    # the closed form of a square: 2 s^4 / (4 mu^2 s^2 + 2 s^4); 2^14 points know it to a percent
    assert part == pytest.approx(0.18 / 1.18, rel=0.02)
    np.testing.assert_allclose(slope, np.eye(1, 7), atol=0.02)
    points, weights = gaussian_nodes(7)
    assert points is gaussian_nodes(7)[0]
    assert len(points) == len(weights) == 2**14


def test_a_constant_observation_has_no_part_outside():
    part, slope = at(lambda x: 0 * x + 7.0, jnp.zeros(2), jnp.eye(2))
    assert part == 0
    np.testing.assert_allclose(slope, 0, atol=1e-5)


@pytest.mark.parametrize("nx", range(1, 7))
def test_tensor_nodes_have_the_moments_of_the_normal(nx):
    points, weights = gaussian_nodes(nx)
    assert len(weights) <= 1e5
    assert weights.sum() == pytest.approx(1, rel=1e-12)
    np.testing.assert_allclose(weights @ points, 0, atol=1e-12)
    np.testing.assert_allclose(points.T @ (weights[:, None] * points), np.eye(nx), atol=1e-11)
    np.testing.assert_allclose(weights @ points**4, 3, rtol=1e-10)
