"""Closed-form moments against quadrature, Monte Carlo, textbook formulas, and in float32."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import reference
from helpers import SIGMAS, quick_jit, random_spd
from mppi_belief.belief import moments as moments

WIDTH = 0.285
THREE = np.array([[3.0, 1.0, 0.2], [3.0, -1.0, 0.0], [2.6, 0.3, -0.3]])
EPS = float(np.finfo(np.float32).eps)

quadratic_moments = quick_jit(moments.quadratic_moments)
bump_sum_moments = quick_jit(moments.bump_sum_moments)
quadratic_bump_covariance = quick_jit(moments.quadratic_bump_covariance)


@pytest.mark.parametrize("diagonal", [True, False])
def test_quadratic_moments_are_the_trace_formulas(diagonal, x64, rng):
    mean, centre = rng.normal(size=(2, 4))
    cov = random_spd(rng, 4)
    weight = rng.uniform(0, 2, 4) if diagonal else random_spd(rng, 4)
    W = np.diag(weight) if diagonal else weight
    d = mean - centre
    expectation, variance = quadratic_moments(mean, cov, centre, weight)
    np.testing.assert_allclose(expectation, 0.5 * d @ W @ d + 0.5 * np.trace(W @ cov), rtol=1e-12)
    np.testing.assert_allclose(
        variance, 0.5 * np.trace(W @ cov @ W @ cov) + d @ W @ cov @ W @ d, rtol=1e-12
    )


def test_quadratic_moments_equal_those_of_samples(x64, rng):
    mean = np.array([1.0, -0.5])
    centre = np.array([0.2, 0.1])
    cov = random_spd(rng, 2)
    W = random_spd(rng, 2)
    computed = quadratic_moments(mean, cov, centre, W)
    values = reference.quadratic(rng.multivariate_normal(mean, cov, 200_000), centre, W)
    assert abs(values.mean() - computed[0]) < SIGMAS * values.std() / np.sqrt(len(values))
    squares = (values - values.mean()) ** 2
    assert abs(squares.mean() - computed[1]) < SIGMAS * squares.std() / np.sqrt(len(values))


@pytest.mark.parametrize("n_obstacles", [1, 2, 3])
@pytest.mark.parametrize("d", [1, 2])
def test_bump_moments_equal_quadrature(d, n_obstacles, x64, rng):
    """From a covariance much smaller to one much larger than the bump, correlated."""
    centers = THREE[:n_obstacles, :d]
    for spread in (0.03, 0.3, 1.0):
        mean = np.append(centers[0] + 0.3 * rng.normal(size=d), 7.0)
        cov = spread**2 * random_spd(rng, d + 1)
        computed = bump_sum_moments(mean, cov, centers, WIDTH)

        def value(x: np.ndarray, centers: np.ndarray = centers) -> np.ndarray:
            return reference.bumps(x, centers, WIDTH)

        expectation, _, variance, *_ = reference.covariance(value, value, mean[:d], cov[:d, :d])
        np.testing.assert_allclose(computed, [expectation, variance], rtol=1e-9)
        np.testing.assert_allclose(
            reference.bump_moments(mean, cov, centers, WIDTH), computed, rtol=1e-9
        )


def test_bump_moments_in_space(x64, rng):
    mean = THREE[1] + 0.2
    cov = 0.2**2 * random_spd(rng, 3)

    def value(x: np.ndarray) -> np.ndarray:
        return reference.bumps(x, THREE, WIDTH)

    expectation, _, variance, *_ = reference.covariance(value, value, mean, cov, nodes=70)
    np.testing.assert_allclose(
        bump_sum_moments(mean, cov, THREE, WIDTH), [expectation, variance], rtol=1e-9
    )


@pytest.mark.parametrize("n_obstacles", [1, 3])
@pytest.mark.parametrize(("n", "d"), [(1, 1), (2, 1), (2, 2), (3, 2)])
def test_quadratic_bump_covariance_equals_quadrature(n, d, n_obstacles, x64, rng):
    centers = THREE[:n_obstacles, :d]
    centre = np.array([7.0, 0.0, 0.5])[:n]
    W = random_spd(rng, n)
    for spread in (0.05, 0.4):
        mean = np.append(centers[0], 0.5)[:n] + 0.3 * rng.normal(size=n)
        cov = spread**2 * random_spd(rng, n)
        _, _, _, _, covariance = reference.covariance(
            lambda x: reference.quadratic(x, centre, W),
            lambda x, centers=centers: reference.bumps(x, centers, WIDTH),
            mean,
            cov,
            nodes=60,
        )
        computed = quadratic_bump_covariance(mean, cov, centre, W, centers, WIDTH)
        np.testing.assert_allclose(computed, covariance, rtol=1e-8, atol=1e-12)


def test_a_diagonal_weight_is_that_diagonal_matrix(x64, rng):
    mean = THREE[0]
    cov = 0.1 * random_spd(rng, 3)
    weight = rng.uniform(0, 2, 3)
    full, short = (
        quadratic_bump_covariance(mean, cov, jnp.zeros(3), W, THREE[:, :2], WIDTH)
        for W in (np.diag(weight), weight)
    )
    np.testing.assert_allclose(short, full, rtol=1e-12)


def float32(*arrays: np.ndarray) -> list[np.ndarray]:
    return [np.asarray(a, dtype=np.float32) for a in arrays]


@pytest.mark.parametrize("spread", [1e-5, 1e-3, 0.1, 0.3, 1.0])
@pytest.mark.parametrize("position", [[2.5, 0.7], [3.0, 1.0], [3.0, 0.0], [1.5, 1.0]])
def test_float32_gives_five_digits_of_mean_and_variance(position, spread):
    """Errors of the inputs' last digit grow by the exponent |d|^2 / (2 l^2), here up to 14."""
    mean, cov, centers = float32(
        position, spread**2 * np.array([[1.0, 0.4], [0.4, 0.8]]), THREE[:2, :2]
    )
    computed = bump_sum_moments(mean, cov, centers, WIDTH)

    def value(x: np.ndarray) -> np.ndarray:
        return reference.bumps(x, centers, np.float32(WIDTH).astype(np.float64))

    wide = [a.astype(np.float64) for a in (mean, cov)]
    expectation, _, variance, *_ = reference.covariance(value, value, *wide)
    assert computed[0].dtype == computed[1].dtype == np.float32
    np.testing.assert_allclose(computed[0], expectation, rtol=1e-5)
    # Half-way between two obstacles their gradients cancel: the digits are those of the terms.
    terms = sum(float(bump_sum_moments(mean, cov, centers[i : i + 1], WIDTH)[1]) for i in range(2))
    np.testing.assert_allclose(computed[1], variance, rtol=1e-5, atol=16 * EPS * terms)


def test_the_usual_difference_of_moments_has_no_digit_left_in_float32():
    """The closed form avoids this: rounded E[q^2] - E[q]^2 has no digit of a small variance."""
    mean = np.array([2.5, 0.7])
    cov = 1e-5**2 * np.eye(2)
    w_obs = np.float32(1e4)
    first, variance = reference.bump_moments(mean, cov, THREE[:2, :2], WIDTH)
    second = variance + first**2
    naive = w_obs**2 * np.float32(second) - (w_obs * np.float32(first)) ** 2
    computed = w_obs**2 * np.asarray(bump_sum_moments(*float32(mean, cov, THREE[:2, :2]), WIDTH)[1])
    _, _, exact, *_ = reference.covariance(
        lambda x: 1e4 * reference.bumps(x, THREE[:2, :2], WIDTH), lambda x: x[:, 0], mean, cov
    )
    assert abs(naive / exact - 1) > 0.5
    assert abs(computed / exact - 1) < 1e-5


@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 2**32 - 1),
    log_spread=st.floats(-5, 3),
    log_distance=st.floats(-9, 6),
    rank=st.integers(1, 3),
)
def test_variances_are_finite_and_not_negative_in_float32(seed, log_spread, log_distance, rank):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, rank)) * 10**log_spread
    # between the obstacles the slopes of two bumps cancel
    mean = np.array([3.0, 0.0, 0.0]) + 10**log_distance * rng.normal(size=3)
    mean, cov, centers = float32(mean, root @ root.T, THREE[:2, :2])
    expectation, variance = bump_sum_moments(mean, cov, centers, WIDTH)
    single = [bump_sum_moments(mean, cov, centers[i : i + 1], WIDTH) for i in range(2)]
    assert np.isfinite(variance)
    assert all(v >= 0 for _, v in single)
    assert variance >= -8 * EPS * sum(float(v) for _, v in single)
    np.testing.assert_allclose(expectation, sum(float(e) for e, _ in single), rtol=4 * EPS)
    assert 0 <= expectation <= 2


@pytest.mark.parametrize("distance", [1e2, 1e4, 1e8, 1e15])
@pytest.mark.parametrize("spread", [0.0, 1e-3, 1.0, 1e3])
def test_far_from_the_obstacles_all_moments_vanish_without_overflow(distance, spread):
    mean, cov = float32([distance, -distance], spread**2 * np.eye(2))
    centers = THREE[:2, :2]
    weight = np.ones(2)
    expectation, variance = bump_sum_moments(mean, cov, centers, WIDTH)
    covariance = quadratic_bump_covariance(mean, cov, np.zeros(2), weight, centers, WIDTH)
    assert np.all(np.isfinite([expectation, variance, covariance]))
    if distance > 20 * spread:
        assert (expectation, variance, covariance) == (0, 0, 0)


def test_certainty_has_no_variance_and_its_own_value():
    zero = jnp.zeros((2, 2))
    for position in ([2.5, 0.7], [3.0, 1.0], [0.0, 0.0]):
        mean = jnp.array(position)
        expectation, variance = bump_sum_moments(mean, zero, THREE[:, :2], WIDTH)
        assert variance == 0
        np.testing.assert_allclose(
            expectation, moments.bump_sum(mean, THREE[:, :2], WIDTH), rtol=1e-5
        )
        assert (
            quadratic_bump_covariance(mean, zero, jnp.ones(2), jnp.ones(2), THREE[:, :2], WIDTH)
            == 0
        )
        assert quadratic_moments(mean, zero, jnp.ones(2), jnp.ones(2))[1] == 0


def test_bump_sum_is_one_at_a_lonely_centre_and_zero_without_centres():
    assert moments.bump_sum(jnp.array([3.0, 1.0, 9.0]), THREE[:1, :2], WIDTH) == 1
    assert moments.bump_sum(jnp.array([3.0, 1.0]), np.zeros((0, 2)), WIDTH) == 0
    np.testing.assert_allclose(
        moments.bump_sum(jnp.array([3.0 + WIDTH]), THREE[:1, :1], WIDTH), np.exp(-0.5), rtol=1e-5
    )


def test_components_and_batches_agree_with_whole_vectors(x64, rng):
    """Planning maps these over samples by vmap and hands over the mean by components."""
    means = rng.normal(size=(3, 5)) + THREE[0][:, None]
    cov = 0.05 * random_spd(rng, 3)
    batched = quick_jit(jax.vmap(moments.bump_sum_moments, in_axes=(-1, None, None, None)))(
        means, cov, THREE[:, :2], WIDTH
    )
    for i in range(5):
        alone = bump_sum_moments([*means[:, i]], cov, THREE[:, :2], WIDTH)
        np.testing.assert_allclose([part[i] for part in batched], alone, rtol=1e-12)
