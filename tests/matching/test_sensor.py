"""A sensor chosen so that matching (15) holds: its definition, its residual, and its limits."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb
from helpers import Feedback, quick_jit, random_spd
from mppi_belief.belief.kalman import aim_sensor_ahead, predict
from mppi_belief.belief.prior import prior
from mppi_belief.belief.schedule import gain_schedule
from mppi_belief.filters import EKF
from mppi_belief.matching.sensor import LEAST_REMAINING, matching_sensor
from mppi_belief.matching.weights import matched_weight, residual
from mppi_belief.simulate import simulate_trial
from system_helpers import platform_problem

TEMPERATURE = 0.8
DT = 0.1
NX = 4
NU = 2


class Case:
    """A covariance, a control channel, R and sigma_o (not diagonal), all random."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.cov = random_spd(rng, NX)
        self.R = random_spd(rng, NU)
        self.G = rng.normal(size=(NX, NU))
        self.noise = rng.normal(size=(3, 3)) + 2 * np.eye(3)
        self.wanted = TEMPERATURE * self.G @ np.linalg.inv(self.R) @ self.G.T

    def sensor(self, dt: float = 0.0, limit: float | None = None) -> np.ndarray:
        root = jnp.linalg.cholesky(self.cov)
        return np.asarray(matching_sensor(root, self.G, self.R, TEMPERATURE, self.noise, dt, limit))

    def sampled(self, C: np.ndarray) -> np.ndarray:
        """D of a measurement every DT, from the covariance of the innovation."""
        S = C @ self.cov @ C.T + self.noise @ self.noise.T / DT
        return self.cov @ C.T @ np.linalg.solve(S, C @ self.cov) / DT

    def continuous(self, C: np.ndarray) -> np.ndarray:
        return self.cov @ C.T @ np.linalg.solve(self.noise @ self.noise.T, C @ self.cov)


@pytest.mark.parametrize("seed", range(4))
def test_what_the_sensor_sees_is_what_the_controls_could_do(seed, x64):
    case = Case(seed)
    case.cov *= 10  # there is enough to be seen in one step
    np.testing.assert_allclose(case.continuous(case.sensor()), case.wanted, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(case.sampled(case.sensor(DT)), case.wanted, rtol=1e-11, atol=1e-11)
    assert np.linalg.norm(case.sampled(case.sensor()) - case.wanted) > 1e-3
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    turned = case.noise @ turn @ np.linalg.solve(case.noise, case.sensor(DT))
    np.testing.assert_allclose(case.sampled(turned), case.wanted, rtol=1e-11, atol=1e-11)


def test_without_a_limit_the_first_rows_measure_in_the_directions_of_the_controls(x64):
    case = Case(0)
    T = np.linalg.cholesky(TEMPERATURE * np.linalg.inv(case.R))
    expected = case.noise[:, :NU] @ T.T @ case.G.T @ np.linalg.inv(case.cov)
    np.testing.assert_allclose(case.sensor(), expected, rtol=1e-11, atol=1e-12)


def test_a_limit_clips_the_signal_to_noise_ratio_to_the_nearest_and_never_raises_the_residual(x64):
    case = Case(1)
    free = np.linalg.solve(case.noise, case.sensor())
    U, s, Vt = np.linalg.svd(free, full_matrices=False)
    W = matched_weight(jnp.asarray(case.R), TEMPERATURE)
    limits = np.geomspace(0.05, 3, 15) * s[0]
    residuals = []
    for limit in limits:
        held = case.sensor(limit=limit)
        nearest = (U[:, :NU] * np.minimum(s[:NU], limit)) @ Vt[:NU]
        np.testing.assert_allclose(
            np.linalg.solve(case.noise, held), nearest, rtol=1e-10, atol=1e-11
        )
        residuals.append(
            float(residual(jnp.asarray(case.continuous(held)), jnp.asarray(case.G), W))
        )
    assert np.all(np.diff(residuals) <= 1e-12)
    assert residuals[0] > 10
    assert residuals[-1] < 1e-12 < 0.1 < residuals[np.sum(limits < s[0]) // 2]


def test_a_covariance_that_is_used_up_is_seen_as_well_as_it_can_be(x64):
    """Where Sigma < lambda G R^-1 G' dt no sensor matches; the best leaves LEAST_REMAINING."""
    case = Case(2)
    case.cov *= 1e-4
    removed = case.sampled(case.sensor(DT)) * DT
    root = np.linalg.cholesky(case.cov)
    along, _ = np.linalg.qr(np.linalg.solve(root, case.G))
    part = along.T @ np.linalg.solve(root, np.linalg.solve(root, removed).T) @ along
    np.testing.assert_allclose(
        np.eye(NU) - part,
        LEAST_REMAINING / (1 + LEAST_REMAINING) * np.eye(NU),
        rtol=1e-6,
        atol=1e-9,
    )


@pytest.mark.parametrize("std", [0.0, 1e-30])
def test_what_is_known_for_certain_is_not_measured(std):
    sensor = matching_sensor(
        jnp.diag(jnp.array([0.5, 0.5, std, 0.5])),
        jnp.eye(4)[:, 2:],
        jnp.eye(2),
        1.0,
        jnp.eye(2),
        DT,
    )
    assert np.all(np.isfinite(sensor))
    np.testing.assert_array_equal(np.asarray(sensor)[:, 2], 0)
    assert np.abs(np.asarray(sensor)[:, 3]).max() > 0.1


def test_fewer_measurements_than_controls_are_refused():
    with pytest.raises(ValueError, match="1 < 2"):
        matching_sensor(jnp.eye(3), jnp.ones((3, 2)), jnp.eye(2), 1.0, jnp.eye(1))


@pytest.mark.parametrize(("method", "convention"), [("filter", "sample"), ("riccati", "intensity")])
def test_matching_holds_along_a_schedule_and_only_with_the_selector(method, convention, x64):
    def largest(problem: mb.Problem) -> float:
        schedule = gain_schedule(problem, prior(problem), jnp.zeros((problem.steps, 2)), method)
        W = matched_weight(problem.cost.R, 1.0)
        return jax.vmap(lambda D: residual(D, problem.system.G(D[0]), W))(schedule.diffusion).max()

    problem = platform_problem(noise_convention=convention, limit=1e6)
    assert quick_jit(largest)(problem) < 1e-12
    assert (
        quick_jit(largest)(
            dataclasses.replace(problem, system=dataclasses.replace(problem.system, limit=0.5))
        )
        > 0.3
    )


def test_the_plant_measures_with_the_sensor_that_the_filter_and_the_plan_have(x64):
    """Compares innovations of trials with their covariance, by the filter's own C."""
    problem = dataclasses.replace(platform_problem(), steps=4)
    n = 300
    trials = quick_jit(jax.vmap(lambda t: simulate_trial(problem, EKF(), Feedback(0.2), 3, t)))(
        jnp.arange(n)
    )
    plan = gain_schedule(problem, prior(problem), jnp.zeros((4, 2)))
    np.testing.assert_allclose(trials.beliefs.cov[0], plan.cov, rtol=1e-10, atol=1e-13)
    jumps = []
    for k in range(4):
        before = mb.Belief(trials.beliefs.mean[0, k], plan.cov[k])
        u = trials.controls[0, k]
        predicted_mean = predict(problem, before, u).mean
        aimed_problem = aim_sensor_ahead(problem, before, u)
        moved = predicted_mean + plan.gain[k] @ (
            trials.measurements[0, k] - aimed_problem.system.c(predicted_mean)
        )
        np.testing.assert_allclose(trials.beliefs.mean[0, k + 1], moved, rtol=1e-9, atol=1e-11)
        errors = np.asarray(trials.states[:, k + 1] - trials.beliefs.mean[:, k + 1])
        whitened = np.linalg.solve(np.linalg.cholesky(np.asarray(plan.cov[k + 1])), errors.T)
        jumps.append(np.sum(whitened**2))
    # Chi-squared with 4 degrees of freedom: another sensor in the plant would leave other errors.
    assert abs(np.mean(jumps) / n - 4) < 4.5 * np.sqrt(8 / n)


def test_a_sensor_once_turned_stays():
    problem = platform_problem()
    turned = aim_sensor_ahead(problem, prior(problem), jnp.zeros(2))
    assert turned.system.selector == "fixed"
    assert np.abs(np.asarray(turned.system.C) - np.eye(2, 4)).max() > 0.1
    assert aim_sensor_ahead(turned, prior(problem), jnp.zeros(2)).system.C is turned.system.C


def test_a_system_that_cannot_be_turned_is_left_alone(light_dark):
    assert aim_sensor_ahead(light_dark, prior(light_dark), jnp.zeros(2)) is light_dark
