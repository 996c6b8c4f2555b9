"""Algorithm 1 as printed: the controller against the line-by-line version of the reference, on the
same normals.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import mppi_belief as mb
import reference
from helpers import CENTERS, light_dark_problem, quick_jit
from mppi_belief.belief.prior import prior
from mppi_belief.belief.schedule import diffusion_factors, gain_schedule
from mppi_belief.planning import path_integral as pi

KEY = jax.random.key(7)
AT_START = mb.RiskSensitive(at_step_end=False)
RICCATI = mb.SharedCovariance("riccati")
FILTER = mb.SharedCovariance("filter")
StateCost = Callable[[np.ndarray, np.ndarray], float]


def printed(
    n_samples: int = 40,
    horizon: int = 6,
    temperature: float = 1.0,
    path_cost: Any = AT_START,
    schedule: mb.SharedCovariance = FILTER,
) -> mb.MPPI:
    """Algorithm 1 as printed."""
    return mb.MPPI(n_samples, horizon, temperature, path_cost, mb.InnovationSampler(), schedule)


class Outcome(NamedTuple):
    u: Array
    plan: Array
    ess: Array
    factors: Array


@quick_jit
def step(problem: mb.Problem, controller: mb.MPPI, start: mb.Belief) -> Outcome:
    """One step on the zero nominal, with the factors L_k, which D_k leaves open up to a
    rotation.
    """
    plan = controller.init(problem)
    factors, _ = diffusion_factors(gain_schedule(problem, start, plan, controller.schedule.method))
    u, after, info = controller.act(problem, start, plan, KEY)
    return Outcome(u, after, info.ess, factors)


def compare(
    problem: mb.Problem,
    controller: mb.MPPI,
    start: mb.Belief,
    model: reference.Linear,
    q: StateCost,
    phi: StateCost,
) -> None:
    """Run both, on the controller's normals and factors."""
    computed = step(problem, controller, start)
    planner = reference.Planner(
        q, phi, np.asarray(problem.cost.R), controller.temperature, problem.dt
    )
    normals = np.asarray(
        pi.normals(KEY, (controller.horizon, len(start.mean), controller.n_samples), False)
    )
    factors = np.asarray(computed.factors)
    mean, cov = (np.asarray(part) for part in start)
    expected = reference.algorithm_1(
        model, planner, mean, cov, normals, factors, controller.schedule.method
    )
    np.testing.assert_allclose(computed.u, expected, rtol=1e-8, atol=1e-10)
    assert np.linalg.norm(computed.u) > 0.01
    assert computed.ess > 2
    np.testing.assert_array_equal(computed.plan, 0)


@pytest.mark.parametrize(
    ("path_cost", "schedule"),
    [
        (mb.RiskSensitive(theta=1.5, at_step_end=False), RICCATI),
        (mb.RiskSensitive(theta=1.5, at_step_end=False), FILTER),
        (mb.CertaintyEquivalent(at_step_end=False), FILTER),
    ],
)
def test_light_dark(path_cost, schedule, x64):
    """A diffusion of rank 2 in four dimensions, risk-sensitive costs next to an obstacle,
    convention "sample".
    """
    goal = np.array([7.0, 0, 0, 0])
    theta = 1.5
    w_obs = 3.0
    at_mean = isinstance(path_cost, mb.CertaintyEquivalent)
    running = np.array([0.2, 0.2, 0.1, 0.1])
    terminal = np.array([0.3, 0.3, 0.1, 0.1])
    problem = light_dark_problem(
        cost={"running_weight": running, "terminal_weight": terminal, "w_obs": w_obs}
    )
    # position and velocity correlated: else D_0 and with it the control would vanish in the
    # velocities
    root = np.array([[0.4, 0, 0, 0], [0.1, 0.3, 0, 0], [0.3, 0.05, 0.1, 0], [0, 0.25, 0, 0.1]])
    start = mb.Belief(jnp.array([2.2, 0.4, 1, 0]), jnp.asarray(root @ root.T))

    def q(mu: np.ndarray, cov: np.ndarray) -> float:
        base = reference.quadratic(mu[None], goal, np.diag(running))[0]
        if at_mean:
            return base + w_obs * reference.bumps(mu[None], np.array(CENTERS), 0.285)[0]
        mean, variance = reference.bump_moments(mu, cov, np.array(CENTERS), 0.285)
        return base + 0.5 * running @ np.diag(cov) + w_obs * mean + theta / 2 * w_obs**2 * variance

    def phi(mu: np.ndarray, cov: np.ndarray) -> float:
        certain = reference.quadratic(mu[None], goal, np.diag(terminal))[0]
        return certain if at_mean else certain + 0.5 * terminal @ np.diag(cov)

    controller = printed(temperature=0.3, path_cost=path_cost, schedule=schedule)
    compare(problem, controller, start, reference.light_dark(sampled=True, dt=0.1), q, phi)


@pytest.mark.parametrize("schedule", [RICCATI, FILTER])
def test_scalar_system(schedule, scalar, x64):
    s = scalar
    problem = scalar.problem(8)
    A, B, C, Q, R_o = (np.array([[v]]) for v in (s.a, s.b, s.c, s.sigma_w**2, s.sigma_o**2))
    controller = printed(50, 8, s.temperature, schedule=schedule)
    compare(
        problem,
        controller,
        prior(problem),
        reference.Linear(A, B, C, Q, lambda x: R_o),
        lambda mu, cov: 0.5 * s.q * (mu[0] ** 2 + cov[0, 0]),
        lambda mu, cov: 0.5 * s.q_T * (mu[0] ** 2 + cov[0, 0]),
    )


def test_uncorrelated_beliefs_do_not_move_the_light_dark_vehicle(light_dark, x64):
    """Paper notes, 4: D_0 has no part in the velocities, where the control acts, so Algorithm 1
    returns nothing.
    """
    controller = printed(schedule=RICCATI)
    np.testing.assert_array_equal(step(light_dark, controller, prior(light_dark)).u, 0)


def test_a_diffusion_of_deficient_rank_gives_a_finite_control_in_float32(light_dark):
    controller = printed(path_cost=mb.RiskSensitive())
    computed = step(light_dark, controller, prior(light_dark))
    assert all(np.linalg.matrix_rank(L) == 2 for L in computed.factors)
    assert np.all(np.isfinite(computed.u))
    assert np.isfinite(computed.ess)


def test_without_anything_to_learn_all_samples_are_the_nominal(x64):
    problem = light_dark_problem(system={"process_noise": 0}, prior_std=[0, 0, 0, 0])
    computed = step(
        problem,
        printed(),
        prior(problem),
    )
    np.testing.assert_array_equal(computed.factors, 0)
    np.testing.assert_array_equal(computed.u, 0)
    np.testing.assert_allclose(computed.ess, 40, rtol=1e-12)
