"""The exactly matched case (Remark 2, Theorems 5 and 6): the controller against the optimal
control.

Scalar system, filter at its steady state, D = lambda b^2 / R: with quadratic costs the expectation
in (19) is a Gaussian integral, and as dt goes to 0 it becomes the feedback of the LQG problem.
"""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import mppi_belief as mb
import reference
from helpers import SIGMAS, Scalar, assert_mean, quick_jit
from mppi_belief.belief.prior import prior

KEYS = 200
SAMPLES = 6000
INNOVATION = {"sampler": mb.InnovationSampler(), "schedule": mb.SharedCovariance("riccati")}
MATCHED = {"sampler": mb.NominalSampler(antithetic=True)}
PLAIN = {"sampler": mb.NominalSampler()}


def controller(s: Scalar, n_samples: int, horizon: int, **parts) -> mb.MPPI:
    path_cost = mb.RiskSensitive(at_step_end=False)
    return mb.MPPI(n_samples, horizon, s.temperature, path_cost, **parts)


def controls(problem: mb.Problem, planner: mb.MPPI, nominal: Array, keys: Array) -> Array:
    """First controls (K,) for independent keys (K,)."""
    return jax.lax.map(
        lambda key: planner.act(problem, prior(problem), nominal, key)[0][0], keys, batch_size=50
    )


# much to compute, or little
optimised = jax.jit(controls)
quick = quick_jit(controls)


def sample(s: Scalar, keys: int, horizon: int = 10, slope: float = 0.0, **options) -> np.ndarray:
    """The same ones, which several tests ask for, are drawn once."""
    return drawn(
        s, keys, horizon, slope, tuple(sorted(options.items(), key=lambda option: option[0]))
    )


@cache
def drawn(s: Scalar, keys: int, horizon: int, slope: float, options: tuple) -> np.ndarray:
    nominal = slope * jnp.linspace(1.0, 0.2, horizon)[:, None]
    planner = controller(s, horizon=horizon, **dict(options))
    compiled = optimised if planner.n_samples > 1000 else quick
    return np.asarray(
        compiled(s.problem(horizon), planner, nominal, jax.random.split(jax.random.key(11), keys))
    )


def exact(s: Scalar, horizon: int = 10) -> float:
    """(19) with the expectation done exactly."""
    dt = s.duration / horizon
    return reference.gaussian_paths(
        s.a, s.b, s.diffusion, s.q, s.q_T, s.mean, dt, horizon, s.temperature
    ).control


def continuous(s: Scalar) -> float:
    return reference.lqg_feedback(s.a, s.b, s.R, s.q, s.q_T, s.mean, s.duration)


@pytest.mark.parametrize(
    ("options", "slope"),
    [
        (INNOVATION, 0.0),
        (MATCHED, 0.0),
        # about any nominal, the Girsanov term brings back the same control
        (MATCHED, -1.5),
        (PLAIN, 1.0),
    ],
)
def test_the_control_is_the_exact_expectation(options, slope, scalar, x64):
    """To a standard error of 0.25 %."""
    assert_mean(sample(scalar, KEYS, n_samples=SAMPLES, slope=slope, **options), exact(scalar))


def test_innovation_and_matched_sampling_are_then_the_same(scalar, x64):
    innovation, matched = (
        sample(scalar, KEYS, n_samples=SAMPLES, **options) for options in (INNOVATION, PLAIN)
    )
    # the factor of a scalar D is its root, so even the samples are the same
    np.testing.assert_allclose(innovation, matched, rtol=1e-8)


def test_a_wrong_nominal_without_its_girsanov_term_would_show(scalar, x64):
    """That the agreement above is the term's doing: alpha = 1 leaves it out."""
    deviation = np.sqrt(scalar.temperature / scalar.R * 10 / scalar.duration)
    with_term, without = (
        sample(
            scalar,
            KEYS,
            n_samples=SAMPLES,
            slope=-1.5,
            sampler=mb.NominalSampler(deviation, alpha, antithetic=True),
        )
        for alpha in (0.0, 1.0)
    )
    assert_mean(with_term, exact(scalar))
    assert abs(without.mean() - exact(scalar)) > 20 * without.std() / np.sqrt(KEYS)


def test_bias_and_spread_fall_with_the_number_of_samples(scalar, x64):
    """The spread as 1 / sqrt(N); the bias of a ratio of averages as 1 / N, seen at N = 10, a tenth
    at N = 100.
    """
    runs = [
        sample(scalar, keys, n_samples=n, **MATCHED)
        for n, keys in ((10, 2000), (100, 2000), (SAMPLES, KEYS))
    ]
    biases = [u.mean() - exact(scalar) for u in runs]
    spreads = [u.std(ddof=1) for u in runs]
    errors = [spread / np.sqrt(len(u)) for spread, u in zip(spreads, runs, strict=True)]
    assert biases[0] > SIGMAS * errors[0]
    assert abs(biases[1]) < 0.1 * biases[0] + SIGMAS * np.hypot(errors[1], 0.1 * errors[0])
    # standard error of the log of a ratio of two sample deviations
    error = np.sqrt(0.5 / len(runs[1]) + 0.5 / len(runs[2]))
    assert abs(np.log(spreads[1] / spreads[2]) - 0.5 * np.log(SAMPLES / 100)) < SIGMAS * error


def test_the_exact_discrete_control_tends_to_lqg_at_first_order(scalar):
    errors = [exact(scalar, H) - continuous(scalar) for H in (20, 40, 80, 160)]
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 1, atol=0.03)


def test_the_control_tends_to_lqg(scalar, x64):
    """Richardson: the first-order error in dt taken off from two horizons, what remains is known
    exactly.
    """
    coarse, fine = (sample(scalar, KEYS, n_samples=SAMPLES, horizon=H, **MATCHED) for H in (10, 20))
    computed = 2 * fine.mean() - coarse.mean()
    error = np.hypot(2 * fine.std(), coarse.std()) / np.sqrt(KEYS)
    remainder = abs(2 * exact(scalar, 20) - exact(scalar, 10) - continuous(scalar))
    assert remainder < error
    assert abs(computed - continuous(scalar)) < SIGMAS * error + remainder
