"""LQG and the oracle: what is possible, and that every controller tends to it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import mppi_belief as mb
from helpers import Scalar, assert_mean, light_dark_problem
from mppi_belief.simulate import controller_belief

TRIALS = jnp.arange(300)
STEPS = 10


def costs(
    problem: mb.Problem,
    controller: mb.Controller,
    filter: mb.Filter | None = None,
    trials: Array = TRIALS,
) -> np.ndarray:
    """Realised costs (trials,), with the same noise for every controller."""

    def trial(index):
        return mb.metrics(
            problem, mb.simulate_trial(problem, filter or mb.EKF(), controller, 0, index)
        ).cost

    return np.asarray(jax.jit(lambda: jax.lax.map(trial, trials, batch_size=50))())


def expected_lqg_cost(s: Scalar, problem: mb.Problem) -> float:
    """E[J] of the optimal feedback, by the value function: a textbook recursion of Riccati and
    Kalman, in NumPy.
    """
    dt = problem.dt
    F = 1 + s.a * problem.dt
    B = s.b * problem.dt
    Q_w = s.sigma_w**2 * dt
    R_s = s.sigma_o**2 / dt
    variances = [s.variance]
    corrections = []
    for _ in range(STEPS):
        predicted = F**2 * variances[-1] + Q_w
        gain = predicted * s.c / (s.c**2 * predicted + R_s)
        corrections.append(gain * s.c * predicted)  # variance of the mean's jump
        variances.append(predicted - gain * s.c * predicted)
    P = s.q_T
    constant = 0.5 * s.q_T * variances[-1]
    for k in reversed(range(STEPS)):
        constant += 0.5 * P * corrections[k] + 0.5 * s.q * dt * variances[k]
        P = s.q * dt + F**2 * P - (F * P * B) ** 2 / (s.R * dt + B**2 * P)
    return 0.5 * P * s.mean**2 + constant


def test_lqg_costs_what_the_value_function_says(scalar, x64):
    problem = scalar.problem(STEPS)
    assert_mean(costs(problem, mb.LQG()), expected_lqg_cost(scalar, problem))


def test_ilqg_is_lqg_on_a_linear_quadratic_problem(scalar, x64):
    problem = scalar.problem(STEPS)
    receding = mb.LQG(horizon=12, at_step_end=True)
    computed = costs(problem, mb.EKFiLQG(horizon=12, tolerance=1e-12))
    np.testing.assert_allclose(computed, costs(problem, receding), rtol=1e-8)


@pytest.mark.parametrize("name", ["belief", "ce", "pipf"])
def test_sampling_controllers_approach_lqg_as_samples_grow(name, scalar):
    problem = scalar.problem(STEPS)
    shared = {"horizon": STEPS, "temperature": scalar.temperature}
    optimal = costs(problem, mb.LQG())

    def excess(n_samples: int) -> np.ndarray:
        if name == "pipf":
            certain = mb.CertaintyEquivalent(at_step_end=False)
            pipf = mb.PIPF(n_samples=max(n_samples // 100, 2), path_cost=certain, **shared)
            return costs(problem, pipf, mb.ParticleFilter(100)) - optimal
        kind = mb.CertaintyEquivalent if name == "ce" else mb.RiskSensitive
        planner = mb.MPPI(n_samples, path_cost=kind(at_step_end=False), **shared)
        return costs(problem, planner) - optimal

    few = excess(40)
    many = excess(4000)
    lqg = expected_lqg_cost(scalar, problem)
    error = many.std(ddof=1) / np.sqrt(len(many))
    # paired by trial: within 3 % of the optimum, the interval's upper end counted in
    assert many.mean() + 3 * error < 0.03 * lqg, (many.mean() / lqg, error / lqg)
    assert many.mean() > -4.5 * error  # nothing beats the optimum
    paired = few - many
    assert paired.mean() > 3 * paired.std(ddof=1) / np.sqrt(len(paired))


def test_an_oracle_is_told_the_true_state_for_certain():
    x = jnp.array([1.0, 2.0])
    belief = mb.Belief(jnp.zeros(2), jnp.eye(2))
    given = controller_belief(mb.OracleMPPI(), belief, x)
    np.testing.assert_array_equal(given.mean, x)
    assert not given.cov.any()
    assert controller_belief(mb.MPPI(), belief, x) is belief


def test_seeing_the_state_is_worth_something():
    problem = light_dark_problem()
    hundred = TRIALS[:100]
    settings = {
        "n_samples": 200,
        "path_cost": mb.CertaintyEquivalent(),
        "sampler": mb.NominalSampler(control_std=2.75),
    }
    blind, seeing = (
        costs(problem, kind(**settings), trials=hundred) for kind in (mb.MPPI, mb.OracleMPPI)
    )
    saved = blind - seeing
    assert saved.mean() > 4.5 * saved.std(ddof=1) / np.sqrt(len(saved))
