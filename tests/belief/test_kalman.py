"""One step of the filter: an independent Kalman filter, and covariances in floating point."""

from contextlib import nullcontext

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from jax import Array

import mppi_belief as mb
import reference
from helpers import float64, light_dark_problem, quick_jit
from mppi_belief.belief import gaussian as gaussians
from mppi_belief.belief import kalman as belief
from mppi_belief.belief.prior import prior
from mppi_belief.numerics.square_root import pivoted_cholesky

PRECISIONS = {"float32": (nullcontext, np.float32), "float64": (float64, np.float64)}


@mb.struct
class Pendulum:
    """Has an angle and a rate, a torque through a turning lever, and nonlinear measurements."""

    damping: float = mb.number(default=0.3)

    @property
    def H(self) -> Array:
        return jnp.array([[0.05, 0.0], [0.1, 0.4]])

    def f(self, x: Array) -> Array:
        return jnp.array([x[1], -9.81 * jnp.sin(x[0]) - self.damping * x[1]])

    def G(self, x: Array) -> Array:
        return jnp.array([[0.0], [jnp.cos(x[0])]])

    def c(self, x: Array) -> Array:
        return jnp.array([jnp.sin(x[0]), x[1] ** 2])

    def sigma_o(self, x: Array) -> Array:
        return jnp.array([[0.1 + x[0] ** 2, 0.0], [0.2, 0.5]])


@quick_jit
def run(problem: mb.Problem, controls: Array, measurements: Array) -> mb.Belief:
    """Beliefs (T,) of a run of predict and correct."""

    def step(
        before: gaussians.RootBelief, data: tuple[Array, Array]
    ) -> tuple[gaussians.RootBelief, mb.Belief]:
        after = belief.correct(problem, belief.predict(problem, before, data[0]), data[1]).posterior
        return after, mb.Belief(after.mean, after.cov)

    mean, cov = prior(problem)
    start = gaussians.RootBelief(mean, pivoted_cholesky(cov))
    return jax.lax.scan(step, start, (controls, measurements))[1]


def test_prior_is_the_problems(light_dark, x64):
    mean, cov = prior(light_dark)
    np.testing.assert_array_equal(mean, [1, 1, 0, 0])
    np.testing.assert_allclose(cov, np.diag([0.04, 0.04, 0.0025, 0.0025]), rtol=1e-15)


@pytest.mark.parametrize("convention", ["sample", "intensity"])
def test_light_dark_equals_an_independent_kalman_filter(convention, x64, rng):
    problem = light_dark_problem(noise_convention=convention)
    dt = 0.1
    model = reference.light_dark(sampled=convention == "sample", dt=dt)
    controls = 3 * rng.normal(size=(25, 2))
    measurements = np.array([4, 0]) + rng.normal(size=(25, 2))
    beliefs = run(problem, controls, measurements)
    mean = np.array(problem.prior_mean)
    cov = np.diag(problem.prior_std**2)
    for k, (u, y) in enumerate(zip(controls, measurements, strict=True)):
        F = np.eye(4) + model.A * dt
        mean = F @ mean + model.B @ u * dt
        cov = F @ cov @ F.T + model.Q * dt
        S = model.C @ cov @ model.C.T + model.intensity(mean) / dt
        K = cov @ model.C.T @ np.linalg.inv(S)
        mean = mean + K @ (y - model.C @ mean)
        cov = (np.eye(4) - K @ model.C) @ cov
        np.testing.assert_allclose(beliefs.mean[k], mean, atol=1e-10)
        np.testing.assert_allclose(beliefs.cov[k], cov, atol=1e-10)


@pytest.mark.parametrize("convention", ["sample", "intensity"])
def test_a_nonlinear_system_equals_an_independent_extended_kalman_filter(convention, x64, rng):
    dt = 0.05
    problem = mb.Problem(
        Pendulum(),
        light_dark_problem().cost,
        [0.8, -0.2],
        [0.3, 0.5],
        dt=dt,
        steps=20,
        noise_convention=convention,
    )
    controls = rng.normal(size=(20, 1))
    measurements = np.stack([np.sin(np.linspace(0.8, -1, 20)), np.linspace(0, 4, 20)], axis=-1)
    beliefs = run(problem, controls, measurements)
    mean = np.array([0.8, -0.2])
    cov = np.diag([0.09, 0.25])
    H = np.array([[0.05, 0.0], [0.1, 0.4]])
    for k, (u, y) in enumerate(zip(controls, measurements, strict=True)):

        def step(x: np.ndarray, torque: float = u[0]) -> np.ndarray:
            return x + dt * np.array(
                [x[1], -9.81 * np.sin(x[0]) - 0.3 * x[1] + np.cos(x[0]) * torque]
            )

        def noise(x: np.ndarray) -> np.ndarray:
            sigma = np.array([[0.1 + x[0] ** 2, 0.0], [0.2, 0.5]])
            return sigma @ sigma.T / (1 if convention == "sample" else dt)

        def measure(x: np.ndarray) -> np.ndarray:
            return np.array([np.sin(x[0]), x[1] ** 2])

        mean, cov = reference.kalman_step(mean, cov, y, step, measure, H @ H.T * dt, noise)
        # central differences are good to 1e-10, and the filter forgets errors
        np.testing.assert_allclose(beliefs.mean[k], mean, atol=1e-8)
        np.testing.assert_allclose(beliefs.cov[k], cov, atol=1e-8)


@quick_jit
def update(cov: Array, C: Array, R_s: Array) -> tuple[Array, Array, Array]:
    root, K, moves = belief.potter_update(pivoted_cholesky(cov), C, R_s)
    return gaussians.covariance(root), K, moves


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(("n", "p"), [(1, 1), (2, 1), (4, 2), (3, 3)])
@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 2**32 - 1),
    log_cov=st.floats(-6, 6),
    log_noise=st.floats(-6, 6),
    rank=st.integers(0, 4),
)
@example(seed=91, log_cov=0.0, log_noise=-5.0, rank=3)
def test_a_measured_covariance_is_symmetric_psd_on_its_own_scale_and_no_larger(
    n, p, precision, seed, log_cov, log_noise, rank
):
    context, dtype = PRECISIONS[precision]
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, min(rank, n))) * 10 ** (log_cov / 2)
    sigma = (np.eye(p) + 0.3 * rng.uniform(-1, 1, size=(p, p))) * 10 ** (log_noise / 2)
    cov = root @ root.T
    R_s = sigma @ sigma.T
    C = rng.normal(size=(p, n))
    with context():
        after = np.asarray(update(*(jnp.asarray(M, dtype=dtype) for M in (cov, C, R_s)))[0])
    np.testing.assert_array_equal(after, after.T)
    eps = float(np.finfo(dtype).eps)
    after = after.astype(np.float64)
    assert np.linalg.eigvalsh(after).min() >= -4 * n * eps * np.linalg.norm(after, 2)
    assert np.linalg.eigvalsh(cov - after).min() >= -50 * eps * np.linalg.norm(cov, 2)
    # against double precision: as far off as the rounding of the prior and of R_s makes it
    # (Joseph's form, in which an error of the gain is of second order)
    S = C @ cov @ C.T + R_s
    gain = np.linalg.solve(S, C @ cov).T
    closed_loop = np.eye(n) - gain @ C
    exact = closed_loop @ cov @ closed_loop.T + gain @ R_s @ gain.T
    assert np.linalg.norm(after - exact) <= 100 * eps * np.linalg.norm(cov, 2), np.linalg.norm(
        after - exact
    )


@quick_jit
def moved_estimator(cov: Array, C: Array, R_s: Array, K: Array) -> Array:
    """Covariance of the estimator m + K (C x + v - C m)."""
    keep = jnp.eye(len(cov)) - K @ C
    return keep @ cov @ keep.T + K @ R_s @ K.T


def test_the_gain_minimises_the_covariance(x64, rng):
    root = rng.normal(size=(3, 3))
    C = rng.normal(size=(2, 3))
    R_s = np.array([[0.3, 0.1], [0.1, 0.9]])
    cov = root @ root.T
    best, K, moves = update(cov, C, R_s)
    S = C @ cov @ C.T + R_s
    np.testing.assert_allclose(K, cov @ C.T @ np.linalg.inv(S), rtol=1e-11)
    np.testing.assert_allclose(moves @ moves.T, K @ S @ K.T, atol=1e-12)
    np.testing.assert_allclose(best, cov - K @ S @ K.T, atol=1e-12)
    for _ in range(10):
        perturbed = moved_estimator(cov, C, R_s, K + 0.1 * rng.normal(size=K.shape))
        assert np.linalg.eigvalsh(perturbed - best).min() >= -1e-12
