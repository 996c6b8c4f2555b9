"""The matching condition (15): the best weight, and the closed form of its residual."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_continuous_are, solve_discrete_are

from helpers import float64, light_dark_problem, quick_jit, random_spd
from mppi_belief.belief.prior import prior
from mppi_belief.belief.schedule import gain_schedule
from mppi_belief.matching.constant_weight import best_constant_weight, optimality_gap
from mppi_belief.matching.weights import best_weight, matched_weight, residual

NX = 4
NU = 2
best = quick_jit(best_weight)
epsilon = quick_jit(residual)
SEEDS = st.integers(0, 2**32 - 1)

# the light-dark vehicle at rest where its sensor is best: sigma_w = 0.3, sigma_o = 0.1
A = np.block([[np.zeros((2, 2)), np.eye(2)], [np.zeros((2, 4))]])
G = np.vstack([np.zeros((2, 2)), np.eye(2)])
C = np.hstack([np.eye(2), np.zeros((2, 2))])
Q = 0.3**2 * G @ G.T
R = 0.1**2 * np.eye(2)


def of_rank(rng: np.random.Generator, rows: int, columns: int, rank: int) -> np.ndarray:
    """A matrix (rows, columns) whose rank is at most `rank`."""
    return rng.normal(size=(rows, rank)) @ rng.normal(size=(rank, columns))


@settings(max_examples=60, deadline=None)
@given(SEEDS, st.integers(1, NX), st.integers(0, NU))
def test_no_other_weight_comes_nearer(seed, rank_D, rank_G):
    rng = np.random.default_rng(seed)
    factor = of_rank(rng, NX, NX, rank_D)
    G = of_rank(rng, NX, NU, rank_G)
    D = factor @ factor.T
    with float64():
        W = np.asarray(best(D, G))
        least = float(epsilon(D, G, W))
        # vec(G W G') = (G x G) vec(W): least squares over all weights, symmetric or not
        free, *_ = np.linalg.lstsq(np.kron(G, G), D.ravel(), rcond=1e-10)
        expected = np.linalg.norm(D.ravel() - np.kron(G, G) @ free) / np.linalg.norm(D)
        assert least == pytest.approx(expected, rel=1e-6, abs=1e-7)
        assert 0 <= least <= 1 + 1e-9
        for size in (1e-3, 0.1, 10.0):
            step = size * rng.normal(size=(NU, NU))
            for perturbed in (W + step, W + step + step.T, (1 + size) * W):
                assert float(epsilon(D, G, perturbed)) >= least - 1e-9
    np.testing.assert_allclose(W, W.T, atol=1e-9 * max(1, abs(W).max()))
    assert np.linalg.eigvalsh((W + W.T) / 2).min() >= -1e-9 * max(1, abs(W).max())


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.integers(1, NU))
def test_a_diffusion_that_controls_can_make_leaves_nothing(seed, rank):
    rng = np.random.default_rng(seed)
    G = random_spd(rng, NX)[:, :NU]
    W = of_rank(rng, NU, NU, rank)
    D = G @ W @ W.T @ G.T
    with float64():
        assert float(epsilon(D, G, W @ W.T)) < 1e-12
        assert float(epsilon(D, G, best(D, G))) < 1e-9
        np.testing.assert_allclose(best(D, G), W @ W.T, atol=1e-9 * np.linalg.norm(W) ** 2)


def test_a_diffusion_that_no_control_reaches_is_left_whole(x64):
    D = np.diag([3.0, 2.0, 0.0, 0.0])
    np.testing.assert_allclose(best(D, G), 0, atol=1e-15)
    assert epsilon(D, G, best(D, G)) == pytest.approx(1, rel=1e-12)
    assert epsilon(D, G, np.diag([2.0, 3.0])) == pytest.approx(math.sqrt(2), rel=1e-12)


def test_the_matched_weight_is_that_of_the_condition(rng, x64):
    weight = random_spd(rng, NU)
    W = quick_jit(matched_weight)(weight, 0.6)
    np.testing.assert_allclose(W @ weight, 0.6 * np.eye(NU), atol=1e-12)
    D = 0.6 * G @ np.linalg.inv(weight) @ G.T
    assert epsilon(D, G, W) < 1e-12
    assert epsilon(2 * D, G, W) == pytest.approx(0.5, rel=1e-9)


def test_the_residual_of_no_diffusion_is_no_number():
    zero = jnp.zeros((NX, NX))
    assert math.isnan(epsilon(zero, G, best(zero, G)))
    assert not math.isfinite(epsilon(zero, G, np.eye(NU)))


def closed_form() -> float:
    """sqrt(1 - (rho^2 / (1 + rho^2))^2), rho = Sigma_pv / Sigma_pp = (q / r)^(1/4) / sqrt(2)."""
    rho_squared = math.sqrt(0.3**2 / 0.1**2) / 2
    return math.sqrt(1 - (rho_squared / (1 + rho_squared)) ** 2)


def test_the_residual_in_the_light_is_the_closed_form_where_sigma_o_is_an_intensity(x64):
    S = solve_continuous_are(A.T, C.T, Q, R)
    D = S @ C.T @ np.linalg.solve(R, C @ S)
    assert closed_form() == pytest.approx(0.8, rel=1e-12)
    assert epsilon(D, G, best(D, G)) == pytest.approx(0.8, rel=1e-9)


@pytest.mark.parametrize(("convention", "method"), [("intensity", "riccati"), ("sample", "filter")])
def test_a_vehicle_that_rests_in_the_light_comes_to_the_steady_states_residual(
    convention, method, x64
):
    problem = light_dark_problem(
        prior_mean=[5, 1, 0, 0],
        prior_std=[0.2, 0.2, 0.2, 0.2],
        steps=400,
        noise_convention=convention,
    )
    schedule = quick_jit(gain_schedule, static_argnames="method")(
        problem, prior(problem), jnp.zeros((400, 2)), method
    )
    D = schedule.diffusion[-1]
    if convention == "intensity":
        expected = closed_form()
    else:  # the filter's step of 0.1 s: K S K' for the covariance before a measurement
        F = np.eye(4) + 0.1 * A
        dt = 0.1
        before = solve_discrete_are(F.T, C.T, Q * dt, R)
        moved = before @ C.T @ np.linalg.solve(C @ before @ C.T + R, C @ before)
        np.testing.assert_allclose(D * dt, moved, rtol=1e-6, atol=1e-12)
        expected = math.sqrt(1 - np.sum(moved[2:, 2:] ** 2) / np.sum(moved**2))
        assert expected == pytest.approx(0.57, abs=0.01)
    assert epsilon(D, G, best(D, G)) == pytest.approx(expected, rel=1e-5)


def schedule(
    rng: np.random.Generator, steps: int, nx: int, nu: int, rank: int
) -> tuple[np.ndarray, np.ndarray]:
    """Diffusions and control channels that change with time."""
    factors = rng.normal(size=(steps, nx, rank))
    return factors @ factors.transpose(0, 2, 1), rng.normal(size=(steps, nx, nu))


def total(D: np.ndarray, G: np.ndarray, W: np.ndarray) -> float:
    apart = np.sum((D - G @ W @ G.transpose(0, 2, 1)) ** 2, axis=(1, 2))
    return float(np.sum(apart / np.sum(D**2, axis=(1, 2))))


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.integers(1, 12), st.integers(1, 4), st.integers(1, 3))
def test_no_other_constant_weight_comes_nearer(seed, steps, nx, nu):
    rng = np.random.default_rng(seed)
    D, G = schedule(rng, steps, nx, nu, rank=1)
    solution = best_constant_weight(D, G)
    assert np.linalg.eigvalsh(solution.weight).min() >= -1e-12 * np.abs(solution.weight).max()
    assert solution.value == pytest.approx(total(D, G, solution.weight), abs=1e-9)
    size = np.linalg.norm(solution.weight) * np.max(
        np.linalg.norm(G, axis=(1, 2)) ** 2 / np.linalg.norm(D, axis=(1, 2))
    )
    assert solution.gap == pytest.approx(
        optimality_gap(D, G, solution.weight), abs=1e-12 * steps * size**2 + 1e-12
    )
    for size in (1e-4, 1e-2, 1.0):
        values, vectors = np.linalg.eigh(solution.weight)
        factor = vectors * np.sqrt(np.maximum(values, 0)) + size * rng.normal(size=(nu, nu))
        perturbed = factor @ factor.T
        # the bound holds for every weight, and is not below what the best one is better by
        assert total(D, G, perturbed) >= solution.value - solution.gap - 1e-12 * steps
        assert (
            optimality_gap(D, G, perturbed)
            >= total(D, G, perturbed) - solution.value - 1e-9 * steps
        )


def test_the_constant_weight_of_a_turning_control_is_the_one_by_hand():
    """D = 1, 10, 1 at 0, 45, 90 degrees: W = a [1 1; 1 1], 4 (a - 1) + 0.4 (0.2 a - 1) = 0.

    Without W >= 0 it is [1 9; 9 1], which leaves nothing.
    """
    push = np.array([[1.0, 0.0], [0.5**0.5, 0.5**0.5], [0.0, 1.0]])[:, None, :]
    D = np.array([1.0, 10.0, 1.0])[:, None, None]
    solution = best_constant_weight(D, push)
    np.testing.assert_allclose(solution.weight, 55 / 51, rtol=1e-6)
    assert solution.value == pytest.approx(32 / 51, abs=solution.gap + 1e-14)
    assert total(D, push, np.array([[1.0, 9.0], [9.0, 1.0]])) < 1e-25


def test_one_step_has_the_best_weight_as_its_constant_one(rng, x64):
    D = random_spd(rng, NX)
    solution = best_constant_weight(D[None], G[None])
    np.testing.assert_allclose(solution.weight, best(D, G), rtol=1e-5)
    assert solution.value == pytest.approx(float(epsilon(D, G, best(D, G))) ** 2, abs=1e-11)
    assert optimality_gap(D[None], G[None], best(D, G)) < 1e-13


def test_steps_without_diffusion_are_left_out(rng):
    D, channels = schedule(rng, 5, NX, NU, rank=2)
    D[[0, 3]] = 0
    solution = best_constant_weight(D, channels)
    without = best_constant_weight(D[[1, 2, 4]], channels[[1, 2, 4]])
    np.testing.assert_array_equal(solution.weight, without.weight)
    assert (solution.value, solution.steps) == (without.value, 3)
    with pytest.raises(ValueError, match="every D_k is zero"):
        best_constant_weight(0 * D, channels)


def test_controls_that_reach_nothing_get_no_weight(rng):
    D, channels = schedule(rng, 4, NX, NU, rank=2)
    solution = best_constant_weight(D, 0 * channels)
    np.testing.assert_array_equal(solution.weight, np.zeros((NU, NU)))
    assert solution.value == pytest.approx(4)
    channels[..., 1] = channels[..., 0]  # two controls that do the same
    twice = best_constant_weight(D, channels)
    once = best_constant_weight(D, channels[..., :1])
    assert twice.value == pytest.approx(once.value, abs=1e-9)


def test_an_unfinished_search_says_how_far_it_may_be():
    push = np.array([[1.0, 0.0], [0.5**0.5, 0.5**0.5], [0.0, 1.0]])[:, None, :]
    early = best_constant_weight(np.array([1.0, 10.0, 1.0])[:, None, None], push, iterations=2)
    assert early.gap > 1e-6
    assert 0 < early.value - 32 / 51 <= early.gap
