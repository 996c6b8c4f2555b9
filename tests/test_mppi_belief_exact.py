"""The exactly matched case (Remark 2, Theorems 5 and 6): the controller against the optimal control.

Scalar system, filter at its steady state, D = lambda b^2 / R: with quadratic costs the expectation in
(19) is a Gaussian integral, and as dt goes to 0 it becomes the feedback of the LQG problem.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import mppi_belief as mb
import reference
from helpers import SIGMAS, Scalar, assert_mean
from mppi_belief.belief import prior

KEYS = 200
INNOVATION = {"diffusion": "innovation", "schedule": "riccati", "antithetic": False}
MATCHED = {"diffusion": "matched", "control_std": None}


def controller(s: Scalar, n_samples: int, horizon: int, **options) -> mb.MPPIBelief:
    return mb.MPPIBelief(n_samples, horizon, s.temperature, charge="start", **options)


@jax.jit
def controls(problem: mb.Problem, planner: mb.MPPIBelief, nominal: Array, keys: Array) -> Array:
    """First controls (K,) for independent keys (K,)."""
    return jax.lax.map(lambda key: planner.act(problem, prior(problem), nominal, key)[0][0], keys, batch_size=50)


def sample(s: Scalar, keys: int, horizon: int = 10, slope: float = 0.0, **options) -> np.ndarray:
    nominal = slope * jnp.linspace(1.0, 0.2, horizon)[:, None]
    planner = controller(s, horizon=horizon, **options)
    return np.asarray(controls(s.problem(horizon), planner, nominal, jax.random.split(jax.random.key(11), keys)))


def exact(s: Scalar, horizon: int = 10) -> float:
    """(19) with the expectation done exactly."""
    dt = s.duration / horizon
    return reference.gaussian_paths(s.a, s.b, s.diffusion, s.q, s.q_T, s.mean, dt, horizon, s.temperature).control


def continuous(s: Scalar) -> float:
    return reference.lqg_feedback(s.a, s.b, s.R, s.q, s.q_T, s.mean, s.duration)


@pytest.mark.parametrize(
    ("options", "slope"),
    [
        (INNOVATION, 0.0),
        (MATCHED, 0.0),
        # about any nominal, the Girsanov term brings back the same control
        (MATCHED, -1.5),
        (MATCHED | {"antithetic": False}, 1.0),
    ],
)
def test_the_control_is_the_exact_expectation(options, slope, scalar, x64):
    """To a standard error of 0.2 %."""
    assert_mean(sample(scalar, KEYS, n_samples=10_000, slope=slope, **options), exact(scalar))


def test_innovation_and_matched_sampling_are_then_the_same(scalar, x64):
    innovation, matched = (
        sample(scalar, KEYS, n_samples=10_000, **options) for options in (INNOVATION, MATCHED | {"antithetic": False})
    )
    # the factor of a scalar D is its root, so even the samples are the same
    np.testing.assert_allclose(innovation, matched, rtol=1e-8)


def test_a_wrong_nominal_without_its_girsanov_term_would_show(scalar, x64):
    """That the agreement above is the term's doing: alpha = 1 leaves it out."""
    deviation = np.sqrt(scalar.temperature / scalar.R * 10 / scalar.duration)
    with_term, without = (
        sample(scalar, KEYS, n_samples=10_000, slope=-1.5, control_std=deviation, alpha=alpha) for alpha in (0.0, 1.0)
    )
    assert_mean(with_term, exact(scalar))
    assert abs(without.mean() - exact(scalar)) > 20 * without.std() / np.sqrt(KEYS)


def test_the_spread_falls_with_the_root_of_the_number_of_samples(scalar, x64):
    spreads = [sample(scalar, KEYS, n_samples=n, **MATCHED).std(ddof=1) for n in (100, 10_000)]
    # standard error of the log of a ratio of two sample deviations
    error = np.sqrt(1 / (KEYS - 1))
    assert abs(np.log(spreads[0] / spreads[1]) - np.log(100) / 2) < SIGMAS * error


def test_the_bias_of_few_samples_falls_with_their_number(scalar, x64):
    """Of order 1 / N for a ratio of two averages: seen at N = 10, a tenth of it at most at N = 100."""
    few, more = (sample(scalar, keys, n_samples=n, **MATCHED) for n, keys in ((10, 10_000), (100, 4000)))
    biases = [u.mean() - exact(scalar) for u in (few, more)]
    errors = [u.std(ddof=1) / np.sqrt(len(u)) for u in (few, more)]
    assert biases[0] > SIGMAS * errors[0]
    assert abs(biases[1]) < 0.1 * biases[0] + SIGMAS * np.hypot(errors[1], 0.1 * errors[0])


def test_the_exact_discrete_control_tends_to_lqg_at_first_order(scalar):
    errors = [exact(scalar, H) - continuous(scalar) for H in (20, 40, 80, 160)]
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 1, atol=0.03)


def test_the_control_tends_to_lqg(scalar, x64):
    """Richardson: the first-order error in dt taken off from two horizons, what remains is known exactly."""
    coarse, fine = (sample(scalar, KEYS, n_samples=10_000, horizon=H, **MATCHED) for H in (10, 20))
    found = 2 * fine.mean() - coarse.mean()
    error = np.hypot(2 * fine.std(), coarse.std()) / np.sqrt(KEYS)
    remainder = abs(2 * exact(scalar, 20) - exact(scalar, 10) - continuous(scalar))
    assert remainder < error
    assert abs(found - continuous(scalar)) < SIGMAS * error + remainder
