"""Beyond the paper: Feynman-Kac where every path carries its own covariance (`belief_joint`).

`scenarios.lit_line` states the Bellman equation of the belief (mu, Sigma) and solves it for one
state.
"""

import jax
import numpy as np
from jax import Array

from ...problem import Problem
from ...results.certificate import Certificate, Check, Line, Panel
from ..bands import at_least, order, quantile, within_errors
from ..estimates import rms
from ..scenarios.lit_line import (
    LIT_TEMPERATURE,
    LogPsi,
    backward_recursion,
    exact_step,
    joint_bellman_residual,
    lit_problem,
)
from ..scenarios.lit_line_paths import sample_plan

RECURSION_STEPS = (4, 8, 16, 32)  # steps of the recursion
JOINT_STARTS = ((-0.6, 0.7), (0.4, 0.6))  # mean and standard deviation of the sampled beliefs
DRAWN_MEANS = 91
JOINT_TEXT = (
    "The desirability that the package samples, each path with the covariance that its own filter "
    "would have, is compared with a backward recursion over mean and variance by quadrature and "
    "splines, and so is the control. V of the recursion is inserted into the nonlinear equation in "
    "(μ, Σ), whose residual vanishes with Δt at first order. The shared covariance of Assumption 1 "
    "would give a value far outside the error. The statement concerns the sampled diffusion "
    "λ G R⁻¹ G'; that the measurements move the mean by D(μ, Σ) remains the paper's approximation."
)


def certify(seed: int = 0) -> Certificate:
    """Returns the certificate: Psi and control at two beliefs, the equation's residual at many."""
    levels = [backward_recursion(lit_problem(steps)) for steps in RECURSION_STEPS]
    residuals = [
        rms(joint_bellman_residual(lit_problem(steps), values))
        for steps, values in zip(RECURSION_STEPS, levels, strict=True)
    ]
    checks = [
        order("equation in (μ, Σ): RMS residual of the recursion's V, order in Δt", 1, residuals)
    ]
    problem = lit_problem(RECURSION_STEPS[1])
    keys = jax.random.split(jax.random.key(seed), len(JOINT_STARTS))
    for start, key in zip(JOINT_STARTS, keys, strict=True):
        checks += belief_checks(problem, levels[1], start, key)
    return Certificate(
        "joint_covariance",
        "Corollary 5 with a covariance for every path",
        JOINT_TEXT,
        checks,
        [_value_panel(levels[-1])],
    )


def belief_checks(
    problem: Problem, values: LogPsi, start: tuple[float, float], key: Array
) -> list[Check]:
    """Returns checks of the sampled Psi, control and shared-covariance value at one belief.

    `start` holds its mean and standard deviation.
    """
    mean, std = start
    log_psi, control = exact_step(problem, values, np.array([mean]), np.array([std**2]))
    psi = np.exp(log_psi[0])
    plan = sample_plan(problem, mean, std, key)
    where = f"at μ = {mean:g}, standard deviation {std:g}"
    value_error = quantile() * LIT_TEMPERATURE * plan.psi_error / plan.psi
    return [
        within_errors(
            f"(17) {where} over the recursion's", plan.psi / psi, 1.0, plan.psi_error / psi
        ),
        within_errors(
            f"(19) {where}: the first control", plan.control, control[0], plan.control_error
        ),
        at_least(
            f"V {where} with a shared covariance: its error",
            abs(plan.shared),
            value_error,
            "largest error that sampling explains",
        ),
    ]


def _value_panel(values: LogPsi) -> Panel:
    means = np.linspace(-2, 2.5, DRAWN_MEANS)
    lines = []
    for std in (0.3, 0.6, 0.9):
        log_variance = np.full(DRAWN_MEANS, 2 * np.log(std))
        V = -LIT_TEMPERATURE * values[0].ev(means, log_variance)
        lines.append(Line(f"standard deviation {std:g}", means.tolist(), V.tolist()))
    return Panel(
        "Value of a belief, the light at 1.5",
        "belief mean μ (dimensionless)",
        "V (dimensionless)",
        lines,
    )
