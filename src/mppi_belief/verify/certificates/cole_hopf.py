"""Theorem 4, Cole-Hopf, by finite differences on the matched scalar problem.

    -dV/dt   = min_u q + 1/2 u' R u + V_mu' (f + G u) + 1/2 tr(D V_mumu)             (13)
    -dV/dt   = q + V_mu' f + 1/2 tr(D V_mumu) - 1/2 V_mu' G R^-1 G' V_mu             (14)
    D        = lambda G R^-1 G'                                                      (15)
    -dPsi/dt = -q / lambda Psi + Psi_mu' f + 1/2 tr(D Psi_mumu)                      (16)

V = -lambda log Psi solves (14) where (15) holds; `solvers.bellman_residual` says what it leaves
otherwise.
"""

import jax.numpy as jnp
import numpy as np

from ...results.certificate import Certificate, Check, Line, Panel
from ..bands import at_most, near, order, rounding
from ..estimates import largest_magnitude, rms
from ..scenarios.matched_scalar import (
    MatchedProblem,
    SteadySchedule,
    matched_problem,
    matching_check,
    scalar_equation,
    steady_schedule,
)
from ..solvers.bellman_residual import (
    REFINEMENTS,
    TwoSolutions,
    bellman_residual,
    solve_both,
    unmatched_residual,
    value_distance,
)
from ..solvers.scalar_equations import ScalarEquation, far_field, first_difference, quadratic

KAPPAS = (0.5, 0.8, 1.25, 2.0)  # factors by which D is off the matched one
DRAWN_KAPPAS = np.linspace(0.5, 2, 31)  # of the curve of the prediction
COLE_HOPF_TEXT = (
    "A dimensionless scalar problem with two obstacles and a risk-sensitive cost, at the filter's "
    "steady state, where (15) holds exactly. The linear equation (16) is solved by Crank and "
    "Nicolson, the Bellman equation (13) by the method of lines with fourth-order differences and "
    "an adaptive integrator. Both share the costs, the cells and the values beyond the grid, which "
    "are those of the Riccati equation; without obstacles both are compared with it inside the "
    "grid too. Without (15) the gradient terms do not cancel: the residual of (14) is "
    "½(κ-1)V_μ'GR⁻¹G'V_μ with the V of that κ. The theorem is exact for given D and q; whether "
    "they describe the belief is not its subject."
)

# For each kappa and grid: the residual of (14) and its prediction.
UnmatchedResiduals = dict[float, list[tuple[np.ndarray, np.ndarray]]]


def certify(seed: int = 0) -> Certificate:
    """Returns the certificate; nothing in it is random, so the seed has no effect."""
    matched = matched_problem()
    schedule = steady_schedule(matched.problem, matched.cov)
    equation = scalar_equation(matched, schedule)

    # Both solutions on every grid, and what each leaves of (14).
    solutions = [solve_both(equation, *size) for size in REFINEMENTS]
    residuals = [rms(bellman_residual(equation, s.grid, s.inner, s.linear)) for s in solutions]
    distances = [value_distance(s.linear, s.direct) for s in solutions]
    unmatched = {
        kappa: [unmatched_residual(equation, kappa, *size) for size in REFINEMENTS]
        for kappa in KAPPAS
    }
    checks = [
        schedule_check(matched, schedule),
        order("RMS residual of (14) at V = -λ log Ψ: order in the cells and steps", 2, residuals),
        order("RMS distance of V by (16) from V by (13), method of lines: order", 2, distances),
        *minimum_checks(matched, equation, solutions[-1]),
        *_quadratic_cost_checks(schedule),
        *_unmatched_checks(unmatched),
    ]
    panels = [
        _cost_to_go_panel(equation, solutions[0]),
        _residual_panel(solutions, residuals),
        _unmatched_panel(equation, residuals[-1], unmatched),
    ]
    return Certificate("cole_hopf", "Theorem 4, Cole-Hopf", COLE_HOPF_TEXT, checks, panels)


def schedule_check(matched: MatchedProblem, schedule: SteadySchedule) -> Check:
    """Returns the check that (15) holds along the schedule."""
    computed = "largest residual ε of (15) along the gain schedule"
    return matching_check(computed, matched.problem, matched.temperature, schedule)


def minimum_checks(
    matched: MatchedProblem, equation: ScalarEquation, solution: TwoSolutions
) -> list[Check]:
    """Returns checks of the minimum in (13) over a grid of controls.

    The parabola through the least three values is exact.
    """
    problem = matched.problem
    G = float(problem.system.G(jnp.zeros(1))[0, 0])
    R = float(problem.cost.R[0, 0])
    gradient = first_difference(solution.linear[0], solution.grid.h)
    controls = np.linspace(-8, 8, 33)
    width = controls[1] - controls[0]

    # The parabola through the least value on the grid and its two neighbours.
    terms_of_u = R / 2 * controls**2 + gradient[:, None] * G * controls
    least = np.argmin(terms_of_u, axis=1)
    below, centre, above = (terms_of_u[np.arange(len(least)), least + j] for j in (-1, 0, 1))
    change = (above - below) / 2
    curvature = above - 2 * centre + below
    best_control = controls[least] - width * change / curvature
    best_value = centre - change**2 / (2 * curvature)

    size = np.max(np.abs([below, centre, above]))
    control_error = best_control + G / R * gradient
    value_error = best_value + equation.authority / 2 * gradient**2
    return [
        rounding(
            "least u in (13) over a grid, parabola between, plus R⁻¹G'V_μ",
            largest_magnitude(control_error),
            20,
            size / R / width,
        ),
        rounding(
            "least value of (13) over u less the control term of (14)",
            largest_magnitude(value_error),
            20,
            size,
        ),
    ]


def _quadratic_cost_checks(schedule: SteadySchedule) -> list[Check]:
    """Checks that V without obstacles is the quadratic of the scalar Riccati equation."""
    equation = scalar_equation(matched_problem(w_obs=0.0, theta=0.0), schedule)
    solutions = [solve_both(equation, *size) for size in REFINEMENTS]
    exact = [
        quadratic(far_field(equation, equation.authority, s.grid.times[:, None]), s.inner)
        for s in solutions
    ]
    linear = [value_distance(s.linear, V) for s, V in zip(solutions, exact, strict=True)]
    direct = [value_distance(s.direct, V) for s, V in zip(solutions, exact, strict=True)]
    return [
        order(
            "linear-quadratic: RMS distance of V by (16) from the Riccati solution, order",
            2,
            linear,
        ),
        at_most(
            "linear-quadratic: RMS distance of V by (13) from the Riccati solution over its bound",
            max(distance / s.time_error for distance, s in zip(direct, solutions, strict=True)),
            1.0,
            "LSODA's tolerance times its steps; the differences are exact for quadratics",
        ),
    ]


def _unmatched_checks(unmatched: UnmatchedResiduals) -> list[Check]:
    """Checks that the residual of (14) is the predicted one for every kappa."""
    ratios = {
        kappa: [
            float(np.sum(residual * predicted) / np.sum(predicted**2))
            for residual, predicted in grids
        ]
        for kappa, grids in unmatched.items()
    }
    changes = {kappa: abs(ratio[-1] - ratio[-2]) for kappa, ratio in ratios.items()}
    worst = max(ratios, key=lambda kappa: abs(ratios[kappa][-1] - 1) / changes[kappa])
    errors = [
        float(np.sqrt(np.mean([rms(residual - predicted) ** 2 for residual, predicted in grids])))
        for grids in zip(*unmatched.values(), strict=True)
    ]
    return [
        near(
            "residual of (14) for D = κλGR⁻¹G' over ½(κ-1)V_μ'GR⁻¹G'V_μ, "
            f"worst κ = {worst:g}: slope",
            ratios[worst][-1],
            1.0,
            changes[worst],
            "its change from the coarser grid, three times what is left at order 2",
        ),
        order("RMS of that residual less its prediction, all κ together: order", 2, errors),
    ]


def _cost_to_go_panel(equation: ScalarEquation, solution: TwoSolutions) -> Panel:
    mu = solution.inner.tolist()
    return Panel(
        "Cost-to-go at t = 0",
        "belief mean μ (dimensionless)",
        "V(0, μ), q(μ) (dimensionless)",
        [
            Line("V by (16), Cole-Hopf", mu, solution.linear[0].tolist()),
            Line("V by (13), method of lines", mu[::5], solution.direct[0, ::5].tolist(), "points"),
            Line("reduced cost q", mu, equation.running(solution.inner).tolist(), "dashed"),
        ],
    )


def _residual_panel(solutions: list[TwoSolutions], residuals: list[float]) -> Panel:
    widths = [s.grid.h for s in solutions]
    second_order = [residuals[-1] * (h / widths[-1]) ** 2 for h in widths]
    return Panel(
        "Residual of the Bellman equation",
        "cell width h (dimensionless)",
        "RMS residual of (14) (dimensionless)",
        [
            Line("computed", widths, residuals, "points"),
            Line("order 2", widths, second_order, "dashed"),
        ],
        "xy",
    )


def _unmatched_panel(
    equation: ScalarEquation, matched_residual: float, unmatched: UnmatchedResiduals
) -> Panel:
    sizes = {1.0: matched_residual}
    sizes |= {kappa: rms(grids[-1][0]) for kappa, grids in unmatched.items()}
    kappas = sorted(sizes)
    predicted = [
        rms(unmatched_residual(equation, kappa, *REFINEMENTS[0])[1]) for kappa in DRAWN_KAPPAS
    ]
    return Panel(
        "Matching broken: D = κ λ G R⁻¹ G'",
        "factor κ, 1 where matching holds",
        "RMS residual of (14) (dimensionless)",
        [
            Line("computed", kappas, [sizes[kappa] for kappa in kappas], "points"),
            Line("½ |κ - 1| V_μ' G R⁻¹ G' V_μ", DRAWN_KAPPAS.tolist(), predicted, "dashed"),
        ],
    )
