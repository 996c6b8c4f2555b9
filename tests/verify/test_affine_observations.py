"""Theorem 1: its certificate, that it can fail, and the part outside the mean tangent space."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers import float64, quick_jit, random_spd
from mppi_belief.discretise import measurement_cov
from mppi_belief.matching.affine import outside_mean_tangent
from mppi_belief.numerics.quadrature import gaussian_nodes
from mppi_belief.results.certificate import Certificate, Check
from mppi_belief.verify.certificates import affine_observations
from mppi_belief.verify.scenarios import mean_tangent, noise_information, section_vii


@pytest.fixture(scope="module")
def certificate() -> Certificate:
    with float64():
        return affine_observations.certify(1)


tangent_part = quick_jit(outside_mean_tangent, static_argnums=0)


def check_named(checks: list[Check], start: str) -> Check:
    """Return the check whose text starts so."""
    (named,) = [check for check in checks if check.computed.startswith(start)]
    return named


def test_the_certificate_holds(certificate):
    assert certificate.holds, [check for check in certificate.checks if not check.holds]
    assert len(certificate.checks) == 10
    affine, cubic, sine, *_ = certificate.panels[0].lines
    assert max(affine.y) < 1e-20
    assert max(cubic.y) > 0.3
    assert max(sine.y) > 0.9


def test_an_observation_that_is_nearly_affine_is_caught(x64, monkeypatch):
    affine = mean_tangent.affine_observation
    monkeypatch.setattr(
        mean_tangent,
        "affine_observation",
        lambda A, b, x: affine(A, b, x) + 1e-7 * jnp.sin(x[0]),
    )
    part, gradient = affine_observations.affine_checks(np.random.default_rng(0))
    assert not part.holds
    assert not gradient.holds


def test_the_closed_forms_tell_a_wrong_part(x64):
    mu = np.linspace(-1.9, 1.9, 6)
    variance = np.array([[mean_tangent.S**2]])
    cubic, sine = mean_tangent.tangent_fits([lambda x: x**3, jnp.sin], mu[:, None], variance)
    closed_form_checks = affine_observations.closed_form_checks
    assert all(check.holds for check in closed_form_checks(mu, cubic, sine))
    wrong = cubic._replace(part=cubic.part + 1e-11)
    assert not check_named(closed_form_checks(mu, wrong, sine), "x³: largest").holds
    affine = sine._replace(part=0 * sine.part)
    assert not check_named(closed_form_checks(mu, cubic, affine), "sin x: least").holds


def test_an_affine_sensor_in_place_of_distance_and_bearing_is_caught(x64, monkeypatch):
    monkeypatch.setattr(mean_tangent, "distance_and_bearing", lambda x: 2 * x + 1)
    zero = mean_tangent.TangentFit(np.zeros(2), np.zeros((2, 1, 1)), 4)
    checks = affine_observations.nonlinear_checks(np.random.default_rng(0), zero, zero)
    assert not any(check.holds for check in checks)


def test_a_filter_that_uses_the_scatter_is_caught(x64, monkeypatch):
    correct = noise_information.correct

    def scatter_using(problem, belief, y):
        correction = correct(problem, belief, y)
        posterior = correction.posterior
        information = jnp.linalg.inv(posterior.cov) + jnp.diag(jnp.array([1.0, 0, 0, 0]))
        root = jnp.linalg.cholesky(jnp.linalg.inv(information))
        return correction._replace(posterior=posterior._replace(root=root))

    monkeypatch.setattr(noise_information, "correct", scatter_using)
    level, ekf = noise_information.noise_level_checks(np.random.default_rng(0))
    assert level.holds
    assert not ekf.holds


def test_the_information_of_another_slope_is_caught(x64, monkeypatch):
    numbers = section_vii.light_dark_numbers()
    monkeypatch.setattr(section_vii, "light_dark_numbers", lambda: numbers | {"noise_slope": 0.6})
    level, _ = noise_information.noise_level_checks(np.random.default_rng(0))
    assert not level.holds


def test_the_fisher_information_is_the_variance_of_the_score(x64, rng):
    """Compare with the covariance of d log p(y | x) / dx, by Monte Carlo."""
    problem = noise_information.one_step_problem("sample", 0.1)
    x = jnp.array([3.0, 1.0, 0.2, 0.1])
    R = measurement_cov(problem, x)

    def log_density(x, y):
        cov = measurement_cov(problem, x)
        deviation = y - problem.system.c(x)
        square = deviation @ jnp.linalg.solve(cov, deviation)
        return -0.5 * (square + jnp.linalg.slogdet(cov)[1])

    y = np.asarray(problem.system.c(x)) + rng.normal(size=(40_000, 2)) * np.sqrt(np.diag(R))
    scores = np.asarray(quick_jit(jax.vmap(jax.grad(log_density), (None, 0)))(x, y))[:, 0]
    squares = scores**2
    parts = quick_jit(lambda x: noise_information.fisher_information(problem, x))(x)
    information = float(sum(part[0, 0] for part in parts))
    assert abs(squares.mean() - information) < 4.5 * squares.std() / np.sqrt(len(squares))
    assert information == pytest.approx(3 / float(R[0, 0]), rel=1e-12)


@quick_jit
def affine_part(A, b, mean, cov, points):
    """Return the part outside by nodes that are no quadrature rule."""
    return outside_mean_tangent(lambda x: A @ x + b, mean, cov, (points, jnp.full(50, 0.02)))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([(1, 1), (2, 8)]))
def test_an_affine_observation_leaves_nothing_on_any_nodes(seed, shape):
    rng = np.random.default_rng(seed)
    ny, nx = shape
    A = rng.normal(size=shape)
    with float64():
        part, slope = affine_part(
            A,
            rng.normal(size=ny),
            rng.normal(size=nx),
            random_spd(rng, nx),
            rng.normal(size=(50, nx)),
        )
        part = float(part)
        slope = np.asarray(slope)
    # 50 nodes: 200 operations, over |A| of at least 1e-3 but for a chance of 1e-3 squared
    assert part < (200 * 2.2e-16 * 1e4) ** 2
    np.testing.assert_allclose(slope, A, atol=1e-11)


def test_quadratics_in_two_dimensions_have_their_closed_form(x64):
    """Take c = p'p / 2 under N(mu, Sigma): A = mu', Var = mu' Sigma mu + tr(Sigma^2) / 2."""
    mean = jnp.array([1.0, -0.4])
    cov = jnp.array([[0.5, 0.1], [0.1, 0.3]])
    part, slope = tangent_part(lambda x: 0.5 * (x @ x)[None], mean, cov)
    outside = 0.5 * jnp.trace(cov @ cov)
    assert part == pytest.approx(float(outside / (mean @ cov @ mean + outside)), rel=1e-10)
    np.testing.assert_allclose(slope, mean[None], rtol=1e-10)


def test_many_states_go_by_a_fixed_point_set(x64):
    mean = jnp.full(7, 0.5)
    cov = 0.09 * jnp.eye(7)
    part, slope = tangent_part(lambda x: x[:1] ** 2, mean, cov)
    # the closed form of a square: 2 s^4 / (4 mu^2 s^2 + 2 s^4); 2^14 points know it to a percent
    assert part == pytest.approx(0.18 / 1.18, rel=0.02)
    np.testing.assert_allclose(slope, np.eye(1, 7), atol=0.02)
    points, weights = gaussian_nodes(7)
    assert points is gaussian_nodes(7)[0]
    assert len(points) == len(weights) == 2**14


def test_a_constant_observation_has_no_part_outside():
    part, slope = tangent_part(lambda x: 0 * x + 7.0, jnp.zeros(2), jnp.eye(2))
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
