"""The solvers of the certificates: closed forms, orders, and slow independent versions."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

import reference
from mppi_belief.verify.bands import observed_orders
from mppi_belief.verify.solvers import grid_solutions
from mppi_belief.verify.solvers.discrete_expectation import DiscreteExpectation
from mppi_belief.verify.solvers.grid_solutions import solve_desirability, solve_value
from mppi_belief.verify.solvers.scalar_equations import (
    MeanGrid,
    Quadratic,
    ScalarEquation,
    far_field,
    first_difference,
    mean_grid,
    quadratic,
    second_difference,
)

A = 0.3
D = 0.7
TEMPERATURE = 0.6
DURATION = 1.0


def equation(q: Quadratic, phi: Quadratic, bump: float = 0.0, **others: float) -> ScalarEquation:
    """Return the equation of a quadratic cost with a Gaussian bump of the given height."""
    rest = {"drift": A, "diffusion": D, "authority": D / TEMPERATURE, "temperature": TEMPERATURE}
    return ScalarEquation(
        **rest | others,
        duration=DURATION,
        reach=6.0,
        running=lambda mu: quadratic(q, mu) + bump * np.exp(-2 * (mu - 0.5) ** 2),
        terminal=lambda mu: quadratic(phi, mu),
        far_running=q,
        far_terminal=phi,
    )


def quadratic_equation(**others: float) -> ScalarEquation:
    return equation(Quadratic(0.2, -0.4, 1.3), Quadratic(0.1, -0.3, 0.9), **others)


def inner(grid: MeanGrid) -> np.ndarray:
    return np.abs(grid.points) <= 2


def test_the_far_field_is_the_riccati_solution():
    terms = equation(Quadratic(0.0, 0.0, 1.3), Quadratic(0.0, 0.0, 0.9))
    _, s, p = far_field(terms, terms.authority, np.array([0.0, DURATION]))
    R = 1 / terms.authority
    assert -p[0] * 1.1 / R == pytest.approx(
        reference.lqg_feedback(A, 1.0, R, 1.3, 0.9, 1.1, DURATION), rel=1e-9
    )
    assert p[1] == pytest.approx(0.9)
    np.testing.assert_allclose(s, 0, atol=1e-12)


def test_the_far_field_solves_the_bellman_equation():
    """Check by differences in time, at any mean, for an authority that is not matched."""
    terms = quadratic_equation()
    authority = 0.8
    mu = np.array([-1.0, 0.4, 2.0])
    dt = 1e-4
    before, now, after = (
        Quadratic(*np.reshape(far_field(terms, authority, np.array([t])), 3))
        for t in (0.4 - dt, 0.4, 0.4 + dt)
    )
    rate = (quadratic(after, mu) - quadratic(before, mu)) / (2 * dt)
    gradient = now.slope + now.curvature * mu
    right = (
        terms.running(mu) + A * mu * gradient + D / 2 * now.curvature - authority / 2 * gradient**2
    )
    np.testing.assert_allclose(-rate, right, atol=1e-6)


def test_the_linear_equation_tends_to_the_riccati_solution_at_second_order():
    terms = quadratic_equation()
    errors = []
    for refine in (1, 2, 4):
        grid = mean_grid(terms, 120 * refine, 10 * refine)
        exact = quadratic(far_field(terms, terms.authority, np.zeros(1)), grid.points)
        V = -TEMPERATURE * np.log(solve_desirability(terms, grid)[0, inner(grid)])
        errors.append(np.max(np.abs((V - exact[inner(grid)])[::refine])))
    np.testing.assert_allclose(observed_orders(errors), 2, atol=0.1)


@pytest.mark.parametrize("cells", [40, 120, 480])
def test_the_method_of_lines_is_exact_for_quadratics_but_for_its_tolerance(cells):
    terms = quadratic_equation(authority=0.8)
    grid = mean_grid(terms, cells, 10)
    V, bound = solve_value(terms, grid)
    exact = quadratic(far_field(terms, terms.authority, grid.times[:, None]), grid.points)
    assert np.max(np.abs(V - exact)) < bound < 1e-3


def test_the_method_of_lines_is_of_fourth_order_with_a_bump():
    terms = quadratic_equation(bump=1.5)
    values = [
        solve_value(terms, mean_grid(terms, 60 * refine, 4))[0][:, ::refine]
        for refine in (1, 2, 4, 8)
    ]
    changes = [np.max(np.abs(fine - coarse)) for coarse, fine in itertools.pairwise(values)]
    np.testing.assert_allclose(observed_orders(changes)[-1], 4, atol=0.3)


def test_the_desirability_is_that_of_a_stiff_integrator():
    """Compare with another scheme in time, for a bump without a closed form."""
    terms = quadratic_equation(bump=1.5)
    grid = mean_grid(terms, 120, 160)
    mu = grid.points
    h = grid.h
    q = terms.running(mu)

    def rate(time_to_go: float, inside: np.ndarray) -> np.ndarray:
        far = far_field(terms, D / TEMPERATURE, np.array([DURATION - time_to_go]))
        ends = np.exp(-np.array([quadratic(far, end)[0] for end in mu[[0, -1]]]) / TEMPERATURE)
        psi = np.concatenate([ends[:1], inside, ends[1:]])
        return (
            -q[1:-1] / TEMPERATURE * inside
            + A * mu[1:-1] * (psi[2:] - psi[:-2]) / (2 * h)
            + D / 2 * (psi[2:] - 2 * inside + psi[:-2]) / h**2
        )

    start = np.exp(-terms.terminal(mu) / TEMPERATURE)[1:-1]
    solution = solve_ivp(rate, (0, 0.2), start, "LSODA", lband=1, uband=1, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(
        solve_desirability(terms, grid)[128, 1:-1], solution.y[:, -1], rtol=2e-3, atol=1e-6
    )


def test_an_integrator_that_gives_up_says_so(monkeypatch):
    terms = quadratic_equation()
    solver = grid_solutions.solve_ivp

    def gives_up(rate, span, start, method, *rest, **settings):
        if method == "LSODA":
            return SimpleNamespace(success=False, message="step too small")
        return solver(rate, span, start, method, *rest, **settings)

    monkeypatch.setattr(grid_solutions, "solve_ivp", gives_up)
    with pytest.raises(RuntimeError, match="step too small"):
        solve_value(terms, mean_grid(terms, 60, 5))


def test_differences_are_exact_for_quadratics():
    mu = np.linspace(-1, 1, 9)
    V = quadratic(Quadratic(0.3, -1.2, 0.7), mu)
    np.testing.assert_allclose(first_difference(V, 0.25), -1.2 + 0.7 * mu[1:-1], atol=1e-12)
    np.testing.assert_allclose(second_difference(V, 0.25), 0.7, atol=1e-12)


@pytest.mark.parametrize("steps", [1, 2, 10])
def test_the_discrete_expectations_are_the_gaussian_integrals(steps):
    terms = equation(Quadratic(0.0, 0.0, 1.3), Quadratic(0.0, 0.0, 0.9))
    discrete = DiscreteExpectation(terms, steps, DURATION)
    mean = 1.1
    dt = DURATION / steps
    exact = reference.gaussian_paths(A, 1.0, D, 1.3, 0.9, mean, dt, steps, TEMPERATURE)
    assert discrete.log_psi(np.array([mean]))[0] == pytest.approx(exact.log_psi, abs=1e-10)
    assert discrete.increment(np.array([mean]))[0][0] == pytest.approx(exact.control, abs=1e-9)


def test_two_steps_with_a_bump_are_the_double_integral():
    terms = quadratic_equation(bump=1.5)
    dt = 0.2
    mean = 0.7
    discrete = DiscreteExpectation(terms, 2, 2 * dt)
    std = np.sqrt(D * dt)

    def running_factor(value: float) -> float:
        return float(np.exp(-terms.running(np.array([value])) * dt / TEMPERATURE)[0])

    def last(mu: float) -> float:
        return average(
            lambda x: float(np.exp(-terms.terminal(np.array([x])) / TEMPERATURE)[0]), mu
        ) * running_factor(mu)

    def average(fn, mu: float) -> float:
        centre = mu * (1 + A * dt)

        def density(x: float) -> float:
            return np.exp(-(((x - centre) / std) ** 2) / 2) / (std * np.sqrt(2 * np.pi))

        return quad(lambda x: fn(x) * density(x), centre - 9 * std, centre + 9 * std, epsabs=1e-11)[
            0
        ]

    psi = average(last, mean)
    moved = [
        average(lambda x, p=p: last(x) * (x - mean * (1 + A * dt)) ** p, mean) / psi / dt**p
        for p in (1, 2)
    ]
    assert np.exp(discrete.log_psi(np.array([mean])))[0] == pytest.approx(
        psi * running_factor(mean), rel=1e-8
    )
    increment = discrete.increment(np.array([mean]))
    np.testing.assert_allclose(np.ravel(increment), [moved[0], moved[1] - moved[0] ** 2], rtol=1e-6)
