"""Matching by choosing what is sensed: the certificate holds, and fails where it should."""

import numpy as np
import pytest

from helpers import float64
from mppi_belief.verify.bands import quantile
from mppi_belief.verify.certificates import controlled_sensing as cs
from mppi_belief.verify.estimates import standard_error
from mppi_belief.verify.scenarios import sensing_systems as systems
from mppi_belief.verify.scenarios import steered_loops as sl
from mppi_belief.verify.scenarios import steered_platform as platform
from mppi_belief.verify.scenarios.limited_sensors import limited_sensor_results
from mppi_belief.verify.scenarios.steered_checks import loop_checks

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def four() -> systems.SensingSchedule:
    with float64():
        return systems.sensing_schedule(
            systems.random_sensing_problem(np.random.default_rng(0), 4, 2), "riccati"
        )


def holds(checks: list) -> list[bool]:
    return [check.holds for check in checks]


def test_two_states_are_matched_and_another_schedule_is_seen(x64):
    problem = systems.random_sensing_problem(np.random.default_rng(1), 2, 2)
    sensing = systems.sensing_schedule(problem)
    assert holds(cs.matched_schedule_checks([sensing])) == [True, True]
    schedule = sensing.schedule._replace(cov=sensing.schedule.cov.at[5].multiply(1 + 1e-9))
    assert holds(cs.matched_schedule_checks([sensing._replace(schedule=schedule)])) == [True, False]
    assert holds(
        cs.matched_schedule_checks([sensing._replace(residuals=sensing.residuals + 1e-9)])
    ) == [False, True]


def test_the_value_is_met_at_order_one_and_a_diffusion_off_by_a_tenth_is_seen(four, x64):
    assert holds(cs.value_checks(four, 0)) == [True] * 4
    schedule = four.schedule._replace(diffusion=1.1 * four.schedule.diffusion)
    value, residual = cs.value_order_checks(four._replace(schedule=schedule))
    assert not value.holds
    assert not residual.holds


def test_the_closed_value_is_the_limit_of_the_control_riccati_recursion(four):
    P, constant = systems.hamiltonian_value(four.problem)
    cost = four.problem.cost
    steps = 20000
    dt = systems.SENSING_DURATION / steps
    A = np.asarray(four.problem.system.A)
    authority = systems.control_authority(four.problem)
    q = np.diag(cost.running_weight)
    value = np.diag(cost.terminal_weight)
    total = 0.0
    for _ in range(steps):
        total += 0.5 * systems.SENSING_TEMPERATURE * dt * np.trace(value @ authority)
        value = value + dt * (q + A.T @ value + value @ A - value @ authority @ value)
    np.testing.assert_allclose(P, value, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(constant, total, rtol=1e-3)


def test_rotated_and_limited_sensors(four, x64):
    checks, panel = limited_sensor_results(four, np.random.default_rng(0))
    assert holds(checks) == [True, True]
    assert max(line.y[0] for line in panel.lines) > 1
    assert all(np.all(np.diff(line.y) <= 1e-12) and line.y[-1] < 1e-12 for line in panel.lines)


def test_the_predicted_excess_is_that_of_the_estimator_itself():
    """Sample one step of the plan in NumPy: the error of sum w delta / sum w, averaged over mu."""
    _, optimum = platform.platform()
    rng = np.random.default_rng(0)
    N = 200
    draws = 4000
    R = platform.CONTROL_WEIGHT * np.eye(2)
    F = optimum.F
    B = optimum.B
    mean = np.array(platform.PLATFORM_START)
    root = np.linalg.cholesky(
        platform.PLATFORM_TEMPERATURE * np.linalg.inv(R) / platform.PLATFORM_DT
    )
    deltas = rng.normal(size=(draws, N, platform.PLATFORM_HORIZON, 2)) @ root.T
    mu = np.broadcast_to(mean, (draws, N, 4))
    costs = 0.0
    for k in range(platform.PLATFORM_HORIZON):
        costs = costs + 0.5 * platform.PLATFORM_DT * np.sum(
            np.array(platform.PLATFORM_WEIGHTS) * mu**2, axis=-1
        )
        mu = mu @ F.T + deltas[:, :, k] @ B.T
    costs = costs + 0.5 * np.einsum("sni,ij,snj->sn", mu, optimum.P, mu)
    w = np.exp((costs.min(axis=1, keepdims=True) - costs) / platform.PLATFORM_TEMPERATURE)
    u = np.einsum("sn,sni->si", w / w.sum(axis=1, keepdims=True), deltas[:, :, 0])
    e = u + optimum.K @ mean
    forms = 0.5 * np.einsum("si,ij,sj->s", e, optimum.S, e)
    expected = first_step(optimum)
    assert (
        abs(N * forms.mean() / expected.per_sample - 1)
        < 4.5 * forms.std() / forms.mean() / draws**0.5 + 2 / N
    )


def first_step(optimum: platform.PlatformOptimum) -> platform.PlatformExcess:
    """Return the prediction for a trial of one step."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(platform, "PLATFORM_STEPS", 1)
        return platform.platform_excess(optimum)


def runs(excess: np.ndarray, excess_cost: float = 0.0) -> list[sl.SteeredLoops]:
    """Draw loops with these mean forms and costs that are `excess_cost` too high."""
    rng = np.random.default_rng(0)
    _, optimum = platform.platform()
    draws = rng.gamma(4, 0.25, size=(2, sl.STEERED_TRIALS))
    forms = np.asarray(excess)[:, None] * draws / draws.mean(axis=1, keepdims=True)
    noise = rng.normal(size=forms.shape)
    noise -= noise.mean(axis=1, keepdims=True) - excess_cost
    return [
        sl.SteeredLoops(platform.platform_optimal_cost(optimum) + form + more, form)
        for form, more in zip(forms, noise, strict=True)
    ]


def test_loops_that_cost_otherwise_are_seen():
    _, optimum = platform.platform()
    expected = platform.platform_excess(optimum)
    best = platform.platform_optimal_cost(optimum)
    right = expected.per_sample / np.array(sl.STEERED_SAMPLES)
    N = np.array(sl.STEERED_SAMPLES)

    def verdicts(excess: np.ndarray, limited: np.ndarray, excess_cost: float = 0.0) -> list[bool]:
        held = [run.form for run in runs(limited)]
        return holds(loop_checks(runs(excess, excess_cost), held, expected, best))

    stays = right + 0.1
    assert verdicts(right, stays) == [True] * 5
    assert verdicts(right, stays, excess_cost=1.0) == [False, True, True, True, True]
    assert verdicts(right[0] * np.sqrt(N[0] / N), stays) == [True, False, False, False, True]
    assert verdicts(stays, stays) == [True, False, False, False, True]
    assert verdicts(right, right) == [True, True, True, True, False]


def test_a_closed_loop_costs_what_is_predicted_and_not_with_a_limited_sensor(x64, monkeypatch):
    monkeypatch.setattr(sl, "STEERED_TRIALS", 100)
    problem, optimum = platform.platform()
    free, limited = sl.steered_closed_loops(optimum, problem, 64, 0, [sl.UNLIMITED, sl.LIMIT])
    expected = platform.platform_excess(optimum)
    bound = quantile(1, 99)
    target = expected.per_sample / 64
    after = target * expected.next_term / 64
    assert abs(free.form.mean() - target) < bound * standard_error(free.form) + after
    assert abs(limited.form.mean() - target) > bound * standard_error(limited.form) + after
