"""The Riccati equation and the gain schedule: SciPy's integrator, fixed points, small steps."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

import mppi_belief as mb
import reference
from helpers import Scalar, light_dark_problem, quick_jit, random_spd, riccati_step
from mppi_belief.belief import kalman as belief
from mppi_belief.belief import riccati
from mppi_belief.belief import schedule as schedules
from mppi_belief.belief.prior import prior
from mppi_belief.discretise import measurement_cov, measurement_intensity

SHAPES = [(1, 1), (2, 1), (4, 2)]
STEPS = 20
INTENSITY = {"noise_convention": "intensity"}
riccati_rate = quick_jit(riccati.riccati_rate)
gain_schedule = quick_jit(schedules.gain_schedule, static_argnames="method")


def random_system(rng: np.random.Generator, n: int, p: int, stable: bool) -> tuple[np.ndarray, ...]:
    """A, Q, C, R_o with the eigenvalues of A moved to either side of the axis."""
    A = rng.normal(size=(n, n))
    real = np.linalg.eigvals(A).real
    A = A - (real.max() + 0.3) * np.eye(n) if stable else A - (real.min() - 0.3) * np.eye(n)
    return A, random_spd(rng, n, 0.1, 1.0), rng.normal(size=(p, n)), random_spd(rng, p, 0.1, 1.0)


@pytest.mark.parametrize("stable", [True, False])
@pytest.mark.parametrize(("n", "p"), SHAPES)
def test_riccati_step_solves_the_riccati_equation(n, p, stable, x64, rng):
    for duration in (0.1, 0.7):
        A, Q, C, R_o = random_system(rng, n, p, stable)
        cov = random_spd(rng, n, 0.01, 3.0)
        computed = riccati_step(cov, A, Q, C, R_o, duration)
        np.testing.assert_allclose(
            computed, reference.riccati_flow(cov, A, Q, C, R_o, duration), rtol=1e-8, atol=1e-10
        )


@pytest.mark.parametrize("stable", [True, False])
@pytest.mark.parametrize(("n", "p"), SHAPES)
def test_the_algebraic_solution_stands_still(n, p, stable, x64, rng):
    A, Q, C, R_o = random_system(rng, n, p, stable)
    steady = solve_continuous_are(A.T, C.T, Q, R_o)
    np.testing.assert_allclose(
        riccati_rate(steady, A, Q, C, R_o), 0, atol=1e-9 * np.linalg.norm(steady) ** 2
    )
    np.testing.assert_allclose(
        riccati_step(steady, A, Q, C, R_o, 0.3), steady, rtol=1e-9, atol=1e-10
    )


def test_riccati_rate_is_the_derivative_of_the_flow(x64, rng):
    A, Q, C, R_o = random_system(rng, 4, 2, stable=True)
    cov = random_spd(rng, 4)
    h = 1e-6
    slope = (
        4 * riccati_step(cov, A, Q, C, R_o, h) - riccati_step(cov, A, Q, C, R_o, 2 * h) - 3 * cov
    ) / (2 * h)
    np.testing.assert_allclose(riccati_rate(cov, A, Q, C, R_o), slope, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize(("n", "p"), SHAPES)
def test_two_half_steps_make_one(n, p, x64, rng):
    A, Q, C, R_o = random_system(rng, n, p, stable=False)
    cov = random_spd(rng, n)
    half = riccati_step(riccati_step(cov, A, Q, C, R_o, 0.2), A, Q, C, R_o, 0.2)
    np.testing.assert_allclose(half, riccati_step(cov, A, Q, C, R_o, 0.4), rtol=1e-10, atol=1e-12)


def test_from_certainty_without_noise_nothing_happens():
    zero = jnp.zeros((2, 2))
    eye = jnp.eye(2)
    np.testing.assert_array_equal(riccati_step(zero, eye, zero, eye, eye, 0.1), 0)


def test_the_scalar_steady_state_is_kept(scalar, x64):
    """What the exact tests of the controller rest on."""
    problem = scalar.problem()
    computed = gain_schedule(problem, prior(problem), jnp.zeros((10, 1)), method="riccati")
    np.testing.assert_allclose(computed.cov.ravel(), scalar.variance, rtol=1e-12)
    np.testing.assert_allclose(
        computed.diffusion.ravel(), scalar.temperature * scalar.b**2 / scalar.R, rtol=1e-12
    )


@pytest.mark.parametrize("method", ["filter", "riccati"])
def test_schedules_tend_to_the_riccati_equation_at_first_order(method, x64):
    """The noise varies along the path, on one side of the light; its kink would lose the order."""
    start = np.array([3.0, 0.5, 1.0, -0.5])
    u = np.array([1.0, 0.5])
    duration = 1.0
    cov = np.diag([0.2, 0.1, 0.05, 0.1])
    exact = reference.belief_flow(
        reference.light_dark(sampled=False, dt=0.0), start, cov, u, duration
    )
    errors = []
    for runs in (
        1,
        2,
        4,
    ):  # one after the other, so that all grids share what was compiled for STEPS
        problem = light_dark_problem(**INTENSITY, dt=duration / (runs * STEPS))
        current = mb.Belief(jnp.asarray(start), jnp.asarray(cov))
        for _ in range(runs):
            computed = gain_schedule(
                problem, current, jnp.broadcast_to(u, (STEPS, 2)), method=method
            )
            current = mb.Belief(computed.mean[-1], computed.cov[-1])
        errors.append(np.linalg.norm(current.cov - exact))
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 1, atol=0.1)


def test_the_filters_diffusion_tends_to_the_continuous_one(x64):
    start = np.array([3.0, 0.5, 1.0, -0.5])
    errors = []
    for dt in (0.01, 0.005, 0.0025):
        problem = light_dark_problem(**INTENSITY, dt=dt)
        current = mb.Belief(jnp.asarray(start), jnp.diag(jnp.array([0.2, 0.1, 0.05, 0.1])))
        filtering, riccati = (
            gain_schedule(problem, current, jnp.zeros((STEPS, 2)), method=m)
            for m in ("filter", "riccati")
        )
        C = np.eye(2, 4)
        R_o = measurement_intensity(problem, start)
        expected = current.cov @ C.T @ np.linalg.inv(R_o) @ C @ current.cov
        np.testing.assert_allclose(riccati.diffusion[0], expected, rtol=1e-12)
        np.testing.assert_allclose(
            riccati.gain[0] @ R_o @ riccati.gain[0].T, expected, rtol=1e-12, atol=1e-15
        )
        errors.append(np.linalg.norm(filtering.diffusion[0] - expected))
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 1, atol=0.1)


@pytest.mark.parametrize("convention", ["sample", "intensity"])
def test_filter_schedule_is_the_filter_that_sees_what_it_expects(convention, x64, rng):
    problem = light_dark_problem(noise_convention=convention)
    controls = rng.normal(size=(STEPS, 2)) * 3
    computed = gain_schedule(problem, prior(problem), jnp.asarray(controls))
    predict = quick_jit(belief.predict)
    correct = quick_jit(belief.correct)
    current = prior(problem)
    dt = problem.dt
    assert [part.shape for part in computed] == [
        (STEPS + 1, 4),
        (STEPS + 1, 4, 4),
        (STEPS, 4, 2),
        (STEPS, 4, 4),
    ]
    for k, u in enumerate(controls):
        np.testing.assert_allclose(computed.mean[k], current.mean, atol=1e-12)
        np.testing.assert_allclose(computed.cov[k], current.cov, atol=1e-12)
        predicted = predict(problem, current, jnp.asarray(u))
        current = correct(problem, predicted, problem.system.c(predicted.mean)).posterior
        # The mean moves by K S K', which is the predicted covariance less the corrected one.
        np.testing.assert_allclose(
            computed.diffusion[k] * dt, predicted.cov - current.cov, atol=1e-12
        )
        y = problem.system.c(predicted.mean) + jnp.array([1.0, 0.0])
        moved = correct(problem, predicted, y).posterior
        np.testing.assert_allclose(computed.gain[k][:, 0], moved.mean - predicted.mean, atol=1e-12)
        S = predicted.cov[:2, :2] + measurement_cov(problem, predicted.mean)
        np.testing.assert_allclose(computed.gain[k] @ S, predicted.cov[:, :2], atol=1e-12)


@pytest.mark.parametrize("method", ["filter", "riccati"])
@pytest.mark.parametrize("steered", [False, True])
def test_only_noise_that_depends_on_the_state_lets_controls_move_the_covariance(
    method, steered, x64, rng
):
    problem = light_dark_problem(system={"noise_slope": 0.7 if steered else 0.0})
    idle, busy = (
        gain_schedule(problem, prior(problem), jnp.asarray(u), method=method)
        for u in (np.zeros((STEPS, 2)), rng.normal(size=(STEPS, 2)) + 4)
    )
    assert np.abs(idle.mean[-1] - busy.mean[-1]).max() > 1
    # relative to the covariance: rounding alone, or a difference that matters
    difference = np.abs(idle.cov[-1] - busy.cov[-1]).max() / np.abs(idle.cov[-1]).max()
    assert difference > 0.1 if steered else difference < 1e-13


@pytest.mark.parametrize("method", ["filter", "riccati"])
@pytest.mark.parametrize("precise", [True, False])
def test_diffusion_factors_have_as_many_columns_as_there_are_measurements(
    method, precise, request, rng
):
    if precise:
        request.getfixturevalue("x64")
    eps = np.finfo(np.float64 if precise else np.float32).eps
    problem = light_dark_problem()
    controls = jnp.asarray(rng.normal(size=(STEPS, 2)) + np.array([3, 0]))
    computed = gain_schedule(problem, prior(problem), controls, method=method)
    L, ranks = quick_jit(schedules.diffusion_factors)(computed)
    for factor, D in zip(L, computed.diffusion, strict=True):
        np.testing.assert_allclose(factor @ factor.T, D, atol=40 * eps * np.abs(D).max())
    np.testing.assert_array_equal(ranks, 2)


def test_scalar_schedule_does_not_care_for_controls(scalar: Scalar, x64, rng):
    problem = scalar.problem(noise_convention="sample")
    idle, busy = (
        gain_schedule(problem, prior(problem), u) for u in (jnp.zeros((9, 1)), jnp.ones((9, 1)))
    )
    np.testing.assert_array_equal(idle.cov, busy.cov)
    np.testing.assert_array_equal(idle.diffusion, busy.diffusion)
    assert not np.allclose(idle.mean[1:], busy.mean[1:])


@pytest.mark.parametrize(
    ("noise", "duration"), [(1e-6, 0.1), (1e-8, 0.1), (0.05, 20.0), (1e-3, 1e3)]
)
@pytest.mark.parametrize("driven", [0.0, 1.0])
def test_riccati_step_stays_finite_and_right_where_the_state_is_seen_very_well(
    noise, duration, driven
):
    unit = jnp.ones((1, 1))
    computed = riccati_step(unit, 0 * unit, driven * unit, unit, noise * unit, duration)[0, 0]
    # dS/dt = q - S^2 / r from S = 1: Bernoulli for q = 0, a hyperbolic cotangent for q = 1
    settled = np.sqrt(noise)
    exact = (
        settled / np.tanh(np.arctanh(settled) + duration / settled)
        if driven
        else 1 / (1 + duration / noise)
    )
    np.testing.assert_allclose(computed, exact, rtol=1e-3)
