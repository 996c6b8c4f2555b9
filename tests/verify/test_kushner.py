"""The grid filter: its Fokker-Planck step, Bayes' rule, and slow independent versions of both."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

import mppi_belief as mb
from helpers import float64
from mppi_belief.verify.bands import observed_orders
from mppi_belief.verify.solvers import kushner
from mppi_belief.verify.solvers.kushner import Coefficients, Moments

numbers = st.floats(-3, 3)


def curved(grid: kushner.StateGrid, Q: float = 0.4, R_o: float = 0.2) -> Coefficients:
    return Coefficients(-np.sin(grid.x), 1 + 0.3 * np.cos(grid.x), Q, grid.x + 0.4 * grid.x**2, R_o)


def dense(bands: np.ndarray) -> np.ndarray:
    """Return the tridiagonal matrix as a dense one."""
    return np.diag(bands[1]) + np.diag(bands[0, 1:], 1) + np.diag(bands[2, :-1], -1)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(slope=numbers, u=numbers, Q=st.floats(0, 2), mean=st.floats(-1, 1), R_o=st.floats(0.05, 5))
def test_no_channel_makes_mass_and_the_moments_move_as_on_the_line(slope, u, Q, mean, R_o):
    grid = kushner.state_grid(-6, 6, 200)
    model = curved(grid, Q, R_o)._replace(f=slope * np.cos(grid.x))
    p = kushner.gaussian_density(grid, mean, 0.3)[:, None]
    a = kushner.drift_channel(kushner.fokker_planck_bands(grid, model, u), p)[:, 0] * grid.h
    b = kushner.diffusion_channel(grid, p, model.c[:, None], R_o)[:, 0] * grid.h
    scale = 1 + Q / grid.h**2 + 40 / R_o
    drift = model.f + model.G * u
    np.testing.assert_allclose([a.sum(), b.sum()], 0, atol=1e-13 * scale)
    np.testing.assert_allclose(grid.x @ a, drift @ p[:, 0] * grid.h, atol=1e-12 * scale)
    np.testing.assert_allclose(
        grid.x**2 @ a, (2 * grid.x * drift + Q) @ p[:, 0] * grid.h, atol=1e-11 * scale
    )
    # Cov(x, x + 0.4 x^2) = S (1 + 0.8 mean) under a Gaussian
    np.testing.assert_allclose(grid.x @ b, 0.3 * (1 + 0.8 * mean) / R_o, rtol=1e-9, atol=1e-9)


def test_the_drift_channel_is_the_fokker_planck_operator_to_second_order():
    errors = []
    for cells in (100, 200, 400):
        grid = kushner.state_grid(-6, 6, cells)
        x = grid.x
        S = 0.25
        u = 0.7
        Q = 0.4
        p = np.exp(-((x - 0.5) ** 2) / (2 * S)) / np.sqrt(2 * np.pi * S)
        slope = -(x - 0.5) / S * p
        bend = ((x - 0.5) ** 2 / S - 1) / S * p
        drift = -np.sin(x) + u * (1 + 0.3 * np.cos(x))
        steepness = -np.cos(x) - 0.3 * u * np.sin(x)
        exact = -steepness * p - drift * slope + Q / 2 * bend
        bands = kushner.fokker_planck_bands(grid, curved(grid), u)
        rate = kushner.drift_channel(bands, p[:, None])[:, 0]
        errors.append(np.abs(rate - exact).max())
    np.testing.assert_allclose(observed_orders(errors), 2, atol=0.05)


@pytest.mark.parametrize("u", [0.0, 1.3])
def test_banded_and_dense_generators_agree_and_the_step_is_second_order(u):
    grid = kushner.state_grid(-4, 4, 80)
    bands = kushner.fokker_planck_bands(grid, curved(grid), u)
    p = kushner.gaussian_density(grid, 0.3, 0.2)[:, None]
    L = dense(bands)
    np.testing.assert_allclose(L.sum(axis=0), 0, atol=1e-11)
    np.testing.assert_allclose(kushner.drift_channel(bands, p), L @ p, rtol=1e-12, atol=1e-12)
    exact = expm(L * 0.2) @ p
    errors = []
    for steps in (8, 16, 32):
        moved = p
        for _ in range(steps):
            moved = kushner.transport(bands, moved, 0.2 / steps)
        errors.append(np.abs(moved - exact).max())
        np.testing.assert_allclose(moved.sum() * grid.h, 1, rtol=1e-12)
    np.testing.assert_allclose(observed_orders(errors), 2, atol=0.05)


def test_the_steady_density_of_a_well_is_boltzmanns():
    grid = kushner.state_grid(-4, 4, 400)
    model = curved(grid)._replace(f=grid.x - grid.x**3)
    p = kushner.gaussian_density(grid, 0.5, 0.3)[:, None]
    for _ in range(400):
        p = kushner.transport(kushner.fokker_planck_bands(grid, model, 0.0), p, 0.2)
    boltzmann = np.exp((grid.x**2 / 2 - grid.x**4 / 4) * 2 / model.Q)
    np.testing.assert_allclose(p[:, 0], boltzmann / (boltzmann.sum() * grid.h), atol=2e-3)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(dy=st.floats(-1, 1), dt=st.floats(0.001, 0.5), R_o=st.floats(0.05, 2), gain=st.floats(-2, 2))
def test_bayes_rule_is_kalmans_on_a_gaussian(dy, dt, R_o, gain):
    grid = kushner.state_grid(-12, 12, 600)
    p = kushner.gaussian_density(grid, 0.4, 0.25)[:, None]
    mean, variance = kushner.density_moments(
        grid, kushner.observe(grid, p, gain * grid.x[:, None], R_o, np.array([dy]), dt)
    )
    expected = 1 / (1 / 0.25 + gain**2 * dt / R_o)
    np.testing.assert_allclose(variance, expected, rtol=1e-9)
    np.testing.assert_allclose(
        mean, expected * (0.4 / 0.25 + gain * dy / R_o), rtol=1e-9, atol=1e-9
    )


def test_far_increments_leave_a_density():
    grid = kushner.state_grid(-6, 6, 100)
    p = kushner.gaussian_density(grid, 0.0, 0.3)[:, None]
    after = kushner.observe(grid, p, 100 * grid.x[:, None], 1e-3, np.array([5.0]), 0.1)
    np.testing.assert_allclose(after.sum() * grid.h, 1)


def test_the_filter_is_the_slow_one():
    """Compare with a dense exponential and Bayes' rule point by point, column by column."""
    rng = np.random.default_rng(0)
    grid = kushner.state_grid(-4, 4, 60)
    dt = 0.01
    model = curved(grid)
    controls = rng.normal(size=8)
    dy = rng.normal(size=(8, 2)) * 0.05
    start = kushner.gaussian_density(grid, 0.3, 0.2)
    moments = kushner.solve_kushner(grid, model, start, controls, dy, dt, substeps=8)
    for path in range(2):
        p = start
        for k, u in enumerate(controls):
            p = expm(dense(kushner.fokker_planck_bands(grid, model, u)) * dt) @ p
            # a measurement dy / dt of variance R_o / dt
            p = p * np.exp(-0.5 * (dy[k, path] / dt - model.c) ** 2 * dt / model.R_o)
            p = p / (p.sum() * grid.h)
            mean = grid.x @ p * grid.h
            np.testing.assert_allclose(moments.mean[k + 1, path], mean, atol=1e-6)
            np.testing.assert_allclose(
                moments.variance[k + 1, path], (grid.x - mean) ** 2 @ p * grid.h, atol=1e-6
            )


@pytest.mark.parametrize("convention", ["intensity", "sample"])
def test_a_systems_coefficients_are_the_systems(convention):
    with float64():
        grid = kushner.state_grid(-1, 1, 7)
        system = mb.ScalarLinear(-0.5, 0.8, 1.2, 0.6, 0.4)
        cost = mb.GoalObstacleCost([0], [1], [1], [1])
        problem = mb.Problem(system, cost, [0], [1], dt=0.05, steps=1, noise_convention=convention)
        model = kushner.coefficients(problem, grid)
    np.testing.assert_allclose(model.f, -0.5 * grid.x)
    np.testing.assert_allclose(model.G, 0.8)
    np.testing.assert_allclose(model.c, 1.2 * grid.x)
    np.testing.assert_allclose(
        [model.Q, model.R_o], [0.36, 0.16 * (0.05 if convention == "sample" else 1)]
    )


def test_extrapolation_takes_the_second_order_term_out():
    exact = np.array([1.0])
    error = np.array([0.3])
    limit = kushner.extrapolated_moments(
        Moments(exact + error, exact + 4 * error), Moments(exact + error / 4, exact + error)
    )
    np.testing.assert_allclose(limit, [exact, exact])
