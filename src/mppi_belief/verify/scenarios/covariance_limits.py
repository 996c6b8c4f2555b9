"""Sigma, K / dt and D of the discrete filter at T as dt goes to zero (Proposition 2)."""

import numpy as np

from ...results.certificate import Check, Line, Panel
from ..bands import EPSILON, at_most, order
from ..solvers.kushner import Reals
from .linear_covariance import (
    PIECE_STEPS,
    STEP_OPERATIONS,
    WIND_DURATION,
    ScheduleFunction,
    frobenius_distance,
    integrated_reference,
    last_piece,
    linear_wind_problem,
    spectral_norm,
)

PIECES = (1, 2, 4, 8, 16)  # of PIECE_STEPS steps over T: ever shorter steps


def short_step_results(schedule: ScheduleFunction) -> tuple[list[Check], Panel]:
    """Returns checks and figure of Sigma, K / dt and D at T as dt goes to zero."""
    reference = integrated_reference()
    exact = {"Σ": reference.cov, "K/Δt": reference.gain, "D": reference.diffusion}
    lengths = [WIND_DURATION / (pieces * PIECE_STEPS) for pieces in PIECES]

    # The discrete filter and the exact Riccati step, for ever shorter steps.
    values: dict[str, list[Reals]] = {name: [] for name in exact}
    riccati_errors = []
    for pieces, dt in zip(PIECES, lengths, strict=True):
        problem = linear_wind_problem(dt)
        last = last_piece(schedule, problem, pieces, "filter")
        values["Σ"].append(np.asarray(last.cov[-1]))
        values["K/Δt"].append(np.asarray(last.gain[-1] / dt))
        values["D"].append(np.asarray(last.diffusion[-1]))
        flow = last_piece(schedule, problem, pieces, "riccati").cov[-1]
        riccati_errors.append(frobenius_distance(flow, reference.cov))
    errors = {
        name: [frobenius_distance(value, exact[name]) for value in values[name]] for name in exact
    }

    steps = PIECES[-1] * PIECE_STEPS
    roundings = steps * reference.condition * STEP_OPERATIONS * EPSILON
    rounded = roundings * spectral_norm(reference.cov)
    checks = [
        order("order in Δt of the discrete filter's Σ at T against (8b)", 1, errors["Σ"]),
        _extrapolation_check(values, exact),
        at_most(
            "Σ at T by the exact Riccati step, 20 to 320 steps, against an integrator",
            max(riccati_errors),
            reference.error + rounded,
            "(local error)(steps)(condition of Σ); no relative error of Σ grows",
        ),
    ]
    lines = [Line(name, lengths, distances) for name, distances in errors.items()]
    first_order = [1.6 * errors["Σ"][0] * dt / lengths[0] for dt in lengths]
    lines.append(Line("order 1", lengths, first_order, "dashed"))
    panel = Panel(
        "The discrete filter tends to (8b)(9)", "Δt (s)", "error at T (Frobenius)", lines, "xy"
    )
    return checks, panel


def _extrapolation_check(values: dict[str, list[Reals]], exact: dict[str, Reals]) -> Check:
    """Checks the limits: one that is wrong by less than the last error hardly changes an order."""
    ratios = []
    for name, levels in values.items():
        before, last = (2 * levels[j] - levels[j - 1] for j in (-2, -1))
        ratios.append(frobenius_distance(last, exact[name]) / frobenius_distance(last, before))
    return at_most(
        "extrapolated limits of Σ, K/Δt, D: distance from (8b)(9) over their last change",
        max(ratios),
        2 / 3,
        "of second order: a third of the last change is missing; twice that",
    )
