"""Theorem 6, the control law (19), against the Bellman equation's control and against LQG.

`scenarios.control_samples` states (19) and its errors, `scenarios.double_integrator` covers a
diffusion of deficient rank, and `scenarios.light_dark_by_hand` compares Algorithm 1 line by line.
"""

import jax
import jax.numpy as jnp
import numpy as np

from ...results.certificate import Certificate, Check, Line, Panel
from ..bands import largest_z, order, quantile, rounding, within_errors
from ..estimates import RepeatedControls, fitted_rate, largest_magnitude, limit_check, rms
from ..scenarios.control_samples import (
    CONTROL_BATCHES,
    CONTROL_GRIDS,
    CONTROL_KEYS,
    CONTROL_MEANS,
    CONTROL_RATE_MEAN,
    CONTROL_SIZES,
    ControlRate,
    exact_control,
    lqg_controls,
    optimal_control,
    sample_control_rate,
    sample_controls,
)
from ..scenarios.double_integrator import deficient_rank_checks
from ..scenarios.light_dark_by_hand import line_by_line_check
from ..scenarios.matched_scalar import (
    MatchedProblem,
    SteadySchedule,
    matched_problem,
    scalar_equation,
    steady_schedule,
)
from ..solvers.discrete_expectation import HERMITE_NODES
from ..solvers.scalar_equations import ScalarEquation

EXPECTATION_STEPS = (10, 20, 40, 80)  # of the exact expectation; the first is sampled
CONTROL_LAW_TEXT = (
    "The exact expectation of (19) for a finite Δt, by a backward recursion, tends to the Bellman "
    "equation's control for a dimensionless scalar problem with obstacles, and to the Riccati "
    "equation's for a double integrator whose D has rank one. Both problems are at the filter's "
    "steady state, where (15) holds and D and q are constant in time. For the light-dark vehicle "
    "D, Σ and so q vary along the plan, and no constant R matches: there the package's Algorithm 1 "
    "is the printed one, line by line and to rounding. Monte Carlo alone resolves the control only "
    "to the percentage named. At a finite Δt, (19) has an error of first order, and at a finite N "
    "a bias of order 1/N."
)


def certify(seed: int = 0) -> Certificate:
    """Returns the certificate: three problems, and the algorithm line by line."""
    matched = matched_problem(steps=EXPECTATION_STEPS[0])
    schedule = steady_schedule(matched.problem, matched.cov)
    equation = scalar_equation(matched, schedule)
    samples_key, rate_key, by_hand_key = jax.random.split(jax.random.key(seed), 3)

    # Without sampling: the expectation of (19) for shorter and shorter steps.
    optimum, optimum_error = optimal_control(matched, equation, CONTROL_MEANS)
    expected = np.stack(
        [exact_control(matched, equation, steps, CONTROL_MEANS) for steps in EXPECTATION_STEPS]
    )
    distances = [rms(u - optimum) for u in expected]

    # With sampling.
    sampled = sample_controls(matched, equation, samples_key)
    rate = sample_control_rate(matched, schedule, equation, rate_key)

    checks = [
        order(
            "exact expectation of (19): RMS distance from -R⁻¹G'V_μ of (16), order in Δt",
            1,
            distances,
        ),
        short_step_check(expected, optimum, optimum_error),
        line_by_line_check(by_hand_key),
        *_sampling_checks(sampled, rate),
        quadratic_cost_check(schedule),
        *deficient_rank_checks(),
    ]
    panels = [
        _control_panel(matched, equation, sampled),
        _step_panel([equation.duration / steps for steps in EXPECTATION_STEPS], distances),
        _samples_panel(rate),
    ]
    return Certificate("control_law", "Theorem 6, control law", CONTROL_LAW_TEXT, checks, panels)


def short_step_check(expected: np.ndarray, optimum: np.ndarray, optimum_error: np.ndarray) -> Check:
    """Returns the check of controls (levels, means), extrapolated to a step of zero."""
    computed = "the same, extrapolated to Δt = 0: largest distance from -R⁻¹G'V_μ over its error"
    return limit_check(computed, list(expected), optimum, optimum_error)


def _sampling_checks(sampled: RepeatedControls, rate: ControlRate) -> list[Check]:
    """Checks the samples of (19): their mean, and how fast their error falls."""
    resolution = (
        quantile(len(CONTROL_MEANS), CONTROL_KEYS - 1) * rms(sampled.error) / rms(sampled.expected)
    )
    relative = 1 / np.sqrt(2 * CONTROL_BATCHES)  # of the RMS of so many Gaussian errors
    slope, slope_error = fitted_rate(CONTROL_SIZES, rate.rms, np.full(len(CONTROL_SIZES), relative))
    return [
        largest_z(
            f"(19) by MPPI-Belief at {len(CONTROL_MEANS)} means (to {resolution:.1%} of u): "
            "distance from its exact expectation",
            sampled.z,
            CONTROL_KEYS - 1,
        ),
        within_errors(
            "RMS error of (19) over N = 2⁸..2¹³: log-log slope", slope, -0.5, slope_error
        ),
        within_errors(
            "mean of (error of (19))² over its variance at leading order in 1/N",
            float(np.mean(rate.squared)),
            1.0,
            2 * relative / np.sqrt(len(CONTROL_SIZES)),
        ),
    ]


def quadratic_cost_check(schedule: SteadySchedule) -> Check:
    """Returns the check without obstacles.

    With a Gaussian Psi the exact expectation is the optimum in steps of the same length.
    """
    matched = matched_problem(w_obs=0.0, theta=0.0)
    equation = scalar_equation(matched, schedule)
    G = float(matched.problem.system.G(jnp.zeros(1))[0, 0])
    R = float(matched.problem.cost.R[0, 0])
    lqg = lqg_controls(matched.problem, matched.cov)
    gap = exact_control(matched, equation, EXPECTATION_STEPS[0], CONTROL_MEANS) - lqg

    # The rounding of a node is that of log Psi, of the size it has at the ends of the grid, and it
    # moves u by as many nodes.
    largest = equation.terminal(np.array([equation.reach]))[0] / equation.temperature
    per_node = G / R * np.sqrt(equation.diffusion / matched.problem.dt) / equation.authority
    return rounding(
        "linear-quadratic: exact expectation of (19) less LQG in the same steps, largest",
        largest_magnitude(gap),
        HERMITE_NODES * EXPECTATION_STEPS[0],
        largest * per_node,
    )


def _control_panel(
    matched: MatchedProblem, equation: ScalarEquation, sampled: RepeatedControls
) -> Panel:
    # Every second cell of the coarser grid.
    means = np.arange(-45, 46) * equation.reach / (CONTROL_GRIDS[0][0] / 4)
    half_width = quantile(len(CONTROL_MEANS), CONTROL_KEYS - 1) * sampled.error
    optimum, _ = optimal_control(matched, equation, means)
    discrete = exact_control(matched, equation, EXPECTATION_STEPS[0], means)
    return Panel(
        "Control at t = 0",
        "belief mean μ (dimensionless)",
        "control u₀ (dimensionless)",
        [
            Line("-R⁻¹G'V_μ", means.tolist(), optimum.tolist()),
            Line("exact expectation of (19)", means.tolist(), discrete.tolist(), "dashed"),
            Line(
                f"(19) by MPPI-Belief, Δt = {equation.duration / EXPECTATION_STEPS[0]:g}",
                CONTROL_MEANS.tolist(),
                sampled.mean.tolist(),
                "points",
                (sampled.mean - half_width).tolist(),
                (sampled.mean + half_width).tolist(),
            ),
        ],
    )


def _step_panel(lengths: list[float], distances: list[float]) -> Panel:
    first_order = [distances[-1] * dt / lengths[-1] for dt in lengths]
    return Panel(
        "Error in the step",
        "step Δt (dimensionless)",
        "RMS over μ of E(19) + R⁻¹G'V_μ (dimensionless)",
        [
            Line("computed", lengths, distances, "points"),
            Line("∝ Δt", lengths, first_order, "dashed"),
        ],
        "xy",
    )


def _samples_panel(rate: ControlRate) -> Panel:
    leading_order = rate.rms / np.sqrt(rate.squared)
    return Panel(
        "Error in the number of samples",
        "number of samples N",
        f"RMS error of (19) at μ = {CONTROL_RATE_MEAN:g} (dimensionless)",
        [
            Line("computed", CONTROL_SIZES.tolist(), rate.rms.tolist(), "points"),
            Line(
                "its standard error to leading order",
                CONTROL_SIZES.tolist(),
                leading_order.tolist(),
                "dashed",
            ),
        ],
        "xy",
    )
