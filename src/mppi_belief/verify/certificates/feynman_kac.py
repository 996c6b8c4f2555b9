"""Corollary 5, Feynman-Kac: the Monte Carlo desirability (17) against the linear equation (16).

`scenarios.desirability_samples` states (17) and computes both sides.
"""

import jax
import numpy as np

from ...results.certificate import Certificate, Check, Line, Panel
from ..bands import largest_z, order, quantile, within_errors
from ..estimates import fitted_rate, limit_check, rms
from ..scenarios.desirability_samples import (
    COARSE_STEPS,
    PSI_BATCHES,
    PSI_GRIDS,
    PSI_LEVELS,
    PSI_MEANS,
    PSI_RATE_MEAN,
    PSI_SIZES,
    PSI_TIMES,
    DesirabilityPoints,
    DesirabilityRate,
    discrete_desirability,
    rate_desirability,
    rate_paths,
    sample_points,
    sample_rate,
)
from ..scenarios.matched_scalar import (
    matched_problem,
    scalar_equation,
    steady_schedule,
    with_time_grid,
)
from ..solvers.grid_solutions import solve_desirability
from ..solvers.scalar_equations import ScalarEquation, mean_grid

FEYNMAN_KAC_TEXT = (
    "The package's sampled desirability is compared with the solution of the linear equation (16), "
    "at five times and nine means of the dimensionless matched scalar problem with obstacles. The "
    "problem is at the filter's steady state: D and q are constant in time, and a schedule that "
    "varies is covered by Theorem 6's certificate. Extrapolation along the same Brownian paths "
    "removes the first-order error in Δt; a backward recursion without sampling bounds what "
    "remains. Without extrapolation a finite Δt biases (17) at first order, whatever N is."
)


def certify(seed: int = 0) -> Certificate:
    """Returns the certificate: Psi at 45 points, and the Monte Carlo rate at one of them."""
    matched = matched_problem(steps=COARSE_STEPS)
    finer = with_time_grid(matched, matched.duration, 2 * COARSE_STEPS)
    schedule = steady_schedule(finer, matched.cov)
    equation = scalar_equation(matched, schedule)
    points_key, rate_key = jax.random.split(jax.random.key(seed))
    points = sample_points(matched, schedule, equation, points_key)
    rate = sample_rate(matched, schedule, equation, rate_key)
    checks = [
        *order_checks(equation, points),
        largest_z(
            f"(17) at {points.z.size} points (t, μ): largest distance from (16), "
            "extrapolated over Δt",
            points.z,
            PSI_BATCHES - 1,
        ),
        *_rate_checks(equation, rate),
    ]
    panels = [_desirability_panel(equation, points), _rate_panel(rate)]
    return Certificate("feynman_kac", "Corollary 5, Feynman-Kac", FEYNMAN_KAC_TEXT, checks, panels)


def order_checks(equation: ScalarEquation, points: DesirabilityPoints) -> list[Check]:
    """Returns checks of the exact discrete expectation at t = 0 against (16)."""
    levels = [discrete_desirability(equation, steps, PSI_TIMES[:1])[0] for steps in PSI_LEVELS]
    errors = [rms(psi - points.exact[0]) for psi in levels]
    return [
        order(
            "exact expectation of (17) over (18): RMS distance from (16), order in Δt", 1, errors
        ),
        limit_check(
            "the same, extrapolated to Δt = 0: largest distance from (16) over its error",
            levels,
            points.exact[0],
            points.exact_error[0],
        ),
    ]


def _rate_checks(equation: ScalarEquation, rate: DesirabilityRate) -> list[Check]:
    """Checks the sampled Psi at one mean against the exact discrete expectation."""
    slope, slope_error = fitted_rate(PSI_SIZES, rate.rms, rate.relative)
    exact = rate_desirability(equation)
    return [
        within_errors(
            f"(17) at one mean from {rate_paths()} paths over the exact discrete expectation",
            rate.mean / exact,
            1.0,
            rate.mean_error / exact,
        ),
        within_errors(
            "RMS error of (17) over N = 2⁶..2¹⁴: log-log slope", slope, -0.5, slope_error
        ),
        within_errors(
            "mean of N (error of (17))² / Var exp(-S/λ), the variance exact",
            rate.squared,
            1.0,
            rate.squared_error,
        ),
    ]


def _desirability_panel(equation: ScalarEquation, points: DesirabilityPoints) -> Panel:
    grid = mean_grid(equation, *PSI_GRIDS[0])
    inside = np.abs(grid.points) <= 2.5
    psi = solve_desirability(equation, grid)[0, inside]
    sampled = points.sampled[0]
    half_width = quantile(points.z.size, PSI_BATCHES - 1) * points.error[0]
    return Panel(
        "Desirability at t = 0",
        "belief mean μ (dimensionless)",
        "desirability Ψ(0, μ) (dimensionless)",
        [
            Line("linear equation (16)", grid.points[inside].tolist(), psi.tolist()),
            Line(
                "Monte Carlo (17)",
                PSI_MEANS.tolist(),
                sampled.tolist(),
                "points",
                (sampled - half_width).tolist(),
                (sampled + half_width).tolist(),
            ),
        ],
    )


def _rate_panel(rate: DesirabilityRate) -> Panel:
    standard_errors = rate.mean_error * np.sqrt(PSI_BATCHES * PSI_SIZES.sum() / PSI_SIZES)
    return Panel(
        "Error of the Monte Carlo desirability",
        "number of samples N",
        f"RMS error of Ψ(0, {PSI_RATE_MEAN:g}) (dimensionless)",
        [
            Line(
                "computed",
                PSI_SIZES.tolist(),
                rate.rms.tolist(),
                "points",
                (rate.rms * (1 - 2 * rate.relative)).tolist(),
                (rate.rms * (1 + 2 * rate.relative)).tolist(),
            ),
            Line(
                "its exact standard error", PSI_SIZES.tolist(), standard_errors.tolist(), "dashed"
            ),
        ],
        "xy",
    )
