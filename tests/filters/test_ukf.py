"""The unscented filter: equal to Kalman's in linear systems and to a textbook form elsewhere."""

from functools import partial
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb
from helpers import light_dark_problem, quick_jit, random_spd
from linear_system import random_problem
from mppi_belief.belief.gaussian import RootBelief
from mppi_belief.filters.ukf import measurement_regression
from mppi_belief.matching.affine import outside_mean_tangent
from mppi_belief.numerics.quadrature import gaussian_nodes, sigma_points
from system_helpers import beacons, pendulum, turned

KEY = jax.random.key(0)


def problem_of(system: mb.System, mean: list[float], std: list[float]) -> mb.Problem:
    n = len(mean)
    cost = mb.GoalObstacleCost([0] * n, [1] * n, [1] * n, [1] * (n // 2))
    return mb.Problem(system, cost, mean, std, dt=0.1, steps=5)


PROBLEMS = {
    "pendulum": partial(problem_of, pendulum(curvature=2.0), [0.9, 0.2], [0.4, 0.3]),
    "beacons": partial(problem_of, beacons(), [0.5, -0.5, 0.3, 1.0], [0.4, 0.3, 0.2, 0.3]),
}


def textbook(
    problem: mb.Problem, mean: np.ndarray, cov: np.ndarray, u: np.ndarray, y: np.ndarray
) -> tuple:
    """Filters with covariances and an inverse; points are sign vectors of at most two entries."""
    system = problem.system
    dt = problem.dt
    n = len(mean)

    def points(m: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        directions = [d for d in product((-1, 0, 1), repeat=n) if 0 < np.abs(d).sum() <= 2]
        sizes = np.array([np.abs(d).sum() for d in directions])
        z = np.sqrt((n + 2) / sizes)[:, None] * np.array(directions)
        w = np.where(sizes == 1, (4 - n) / 2, 1.0) / (n + 2) ** 2
        return m + np.vstack([np.zeros(n), z]) @ np.linalg.cholesky(P).T, np.append(2 / (n + 2), w)

    x, w = points(mean, cov)
    moved = x + dt * np.asarray(quick_jit(jax.vmap(lambda p: system.f(p) + system.G(p) @ u))(x))
    mean = w @ moved
    cov = np.einsum("p,pi,pj->ij", w, moved - mean, moved - mean) + dt * np.asarray(
        system.H @ system.H.T
    )
    x, w = points(mean, cov)
    measured = np.asarray(quick_jit(jax.vmap(system.c))(x))
    expected = w @ measured
    S = (
        np.einsum("p,pi,pj->ij", w, measured - expected, measured - expected)
        + np.asarray(system.sigma_o(mean)) ** 2
    )
    K = np.einsum("p,pi,pj->ij", w, x - mean, measured - expected) @ np.linalg.inv(S)
    return mean + K @ (y - expected), cov - K @ S @ K.T, expected, S


@pytest.mark.parametrize("name", PROBLEMS)
def test_it_is_the_textbooks(x64, rng, name):
    """Where no bearing wraps, and from a diagonal covariance: another root turns the points."""
    problem = PROBLEMS[name]()
    start = mb.UKF().init(problem, KEY)
    u = rng.normal(size=problem.cost.R.shape[0])
    y = np.asarray(quick_jit(problem.system.c)(start.mean)) + 0.05
    after = quick_jit(mb.UKF().update)(problem, start, u, y, KEY)
    mean, cov, expected, S = textbook(problem, np.asarray(start.mean), np.asarray(start.cov), u, y)
    np.testing.assert_allclose(after.mean, mean, atol=1e-10)
    np.testing.assert_allclose(after.cov, cov, atol=1e-10)
    predicted = quick_jit(mb.UKF().predict)(problem, start, u)
    correction = quick_jit(mb.UKF().correct)(problem, predicted, y)
    np.testing.assert_allclose(correction.innovation, y - expected, atol=1e-10)
    np.testing.assert_allclose(correction.innovation_cov, S, atol=1e-10)
    assert np.linalg.eigvalsh(start.cov - after.cov).max() > 1e-3


@pytest.mark.parametrize("nx", [1, 3, 6])
def test_it_is_kalmans_on_a_linear_system(x64, rng, nx):
    """With either rule: six states have that of degree 3."""
    problem = random_problem(rng, nx=nx)
    u = rng.normal(size=2)
    y = rng.normal(size=1)
    unscented, exact = (
        quick_jit(filter.update)(problem, filter.init(problem, KEY), u, y, KEY)
        for filter in (mb.UKF(), mb.EKF())
    )
    np.testing.assert_allclose(unscented.mean, exact.mean, atol=1e-10)
    np.testing.assert_allclose(unscented.cov, exact.cov, atol=1e-10)


@pytest.mark.parametrize("n", range(1, 8))
def test_no_weight_is_negative_and_two_moments_are_exact(n):
    z, w = sigma_points(n)
    assert np.all(w > 0)
    np.testing.assert_allclose(w.sum(), 1)
    np.testing.assert_allclose(w @ z, 0, atol=1e-14)
    np.testing.assert_allclose((w[:, None] * z).T @ z, np.eye(n), atol=1e-13)


def test_what_it_takes_for_noise_is_the_part_outside_the_tangent_space(x64, rng):
    """Of a quadratic c the rule has all moments that Theorem 1's residual is made of."""

    @mb.struct
    class Bent:
        def c(self, x):
            return jnp.array([x[0] + 0.4 * x[0] * x[1], x[2] - 0.3 * x[2] ** 2 + x[1]])

        def sigma_o(self, x):
            return jnp.eye(2)

    mean = rng.normal(size=3)
    cov = random_spd(rng, 3, 0.2, 0.6)
    root = np.linalg.cholesky(cov)
    problem = random_problem(rng)
    bent = mb.Problem(Bent(), problem.cost, mean, np.ones(3), dt=0.1, steps=1)
    fit = quick_jit(measurement_regression)(bent, RootBelief(mean, root))
    nodes = gaussian_nodes(3, 5)
    part, A = quick_jit(lambda: outside_mean_tangent(Bent().c, mean, cov, nodes))()
    remainder = np.trace(fit.noise - np.eye(2))
    np.testing.assert_allclose(remainder / (remainder + np.sum(fit.slope**2)), part, rtol=1e-9)
    np.testing.assert_allclose(fit.slope, root.T @ A.T, atol=1e-10)
    assert part > 0.05


def test_covariances_stay_semidefinite_where_some_is_known_exactly():
    """Single precision, a sensor that is nearly perfect, a prior without any doubt of the rate."""
    problem = problem_of(pendulum(sensor_noise=1e-5, process_noise=0.0), [1.4, 0.0], [0.3, 0.0])
    update = quick_jit(mb.UKF().update)
    belief = mb.UKF().init(problem, KEY)
    for k in range(20):
        y = problem.system.c(belief.mean) + 1e-3 * (-1.0) ** k
        belief = update(problem, belief, jnp.array([2.0]), y, KEY)
        assert np.all(np.isfinite(belief.mean))
        assert np.linalg.eigvalsh(belief.cov).min() >= -1e-6 * np.trace(belief.cov)


def test_it_is_the_extended_filter_in_the_paper_s_system(x64):
    """Linear there; the noise that depends on the state is that at the predicted mean for both."""
    problem = light_dark_problem()
    u = np.array([1.0, -2.0])
    y = np.array([1.3, 0.8])
    unscented, expected = (
        quick_jit(filter.update)(problem, filter.init(problem, KEY), u, y, KEY)
        for filter in (mb.UKF(), mb.EKF())
    )
    np.testing.assert_allclose(unscented.mean, expected.mean, atol=1e-10)
    np.testing.assert_allclose(unscented.cov, expected.cov, atol=1e-10)


def test_bearings_behind_it_are_averaged_across_the_jump(x64):
    """Bearings on both sides of the jump are a turn apart; their mean lies between them."""
    problem = problem_of(beacons(anchor=[1.0, 1.0]), [1.0, -4.0, 0.0, 0.5], [0.3, 0.3, 0.1, 0.1])
    predicted = quick_jit(mb.UKF().predict)(problem, mb.UKF().init(problem, KEY), np.zeros(2))
    y = np.array([0.0, np.pi / 2, *np.zeros(4)])
    correction = quick_jit(mb.UKF().correct)(problem, predicted, y)
    assert abs(turned(np.asarray(correction.innovation[1]))) < 0.1
    assert correction.innovation_cov[1, 1] < 0.2
