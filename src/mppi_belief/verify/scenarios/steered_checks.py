"""Checks of the closed loops on the platform: their excess cost is the predicted c/N.

`steered_platform` derives the excess cost.
"""

import math
from collections.abc import Sequence

import numpy as np

from ...results.certificate import Check, Line, Panel
from ..bands import at_least, largest_z, near, quantile, within_errors
from ..estimates import standard_error
from . import steered_platform
from .steered_loops import (
    LIMIT,
    STEERED_SAMPLES,
    STEERED_TRIALS,
    UNLIMITED,
    SteeredLoops,
    steered_closed_loops,
)
from .steered_platform import PlatformExcess


def platform_results(seed: int) -> tuple[list[Check], Panel]:
    """Returns the checks and the figure of the closed loops."""
    problem, optimum = steered_platform.platform()
    predicted = steered_platform.platform_excess(optimum)
    best = steered_platform.platform_optimal_cost(optimum)
    few, many = (
        steered_closed_loops(optimum, problem, samples, seed, [UNLIMITED, LIMIT])
        for samples in STEERED_SAMPLES
    )
    matched = [few[0], many[0]]
    limited = [few[1].form, many[1].form]
    checks = loop_checks(matched, limited, predicted, best)
    return checks, _platform_panel([loops.form for loops in matched], limited, predicted, best)


def infinite_sample_excess(forms: Sequence[np.ndarray]) -> np.ndarray:
    """Returns the excess (trials,) for N -> infinity, from the forms at both N.

    The excess is taken to be a + c/N.
    """
    few, many = STEERED_SAMPLES
    return (many * forms[1] - few * forms[0]) / (many - few)


def loop_checks(
    loops: Sequence[SteeredLoops],
    limited: Sequence[np.ndarray],
    predicted: PlatformExcess,
    best: float,
) -> list[Check]:
    """Returns checks of loops with the matched sensor and forms with the limited one."""
    forms = [loop.form for loop in loops]
    return [
        _martingale_check(loops, best),
        _form_check(forms, predicted),
        _rate_check(forms, predicted),
        *_limit_checks(forms, limited, predicted),
    ]


def _both_sizes() -> str:
    few, many = STEERED_SAMPLES
    return f"N = {few} and {many}"


def _martingale_check(loops: Sequence[SteeredLoops], best: float) -> Check:
    """Checks that cost less form is the optimal cost."""
    gaps = [(loop.cost - loop.form).mean() - best for loop in loops]
    errors = [standard_error(loop.cost - loop.form) for loop in loops]
    return largest_z(
        f"platform: cost less Σ ½ e'Se less the optimal cost, {_both_sizes()}",
        np.array(gaps) / errors,
        STEERED_TRIALS - 1,
    )


def _form_check(forms: Sequence[np.ndarray], predicted: PlatformExcess) -> Check:
    """Checks that the form is c/N, up to the next term."""
    expected = predicted.per_sample / np.array(STEERED_SAMPLES)
    next_terms = predicted.next_term / np.array(STEERED_SAMPLES)
    means = np.array([form.mean() for form in forms])
    errors = np.array([standard_error(form) for form in forms])
    unexplained = np.maximum(np.abs(means - expected) - expected * next_terms, 0) / errors
    return largest_z(
        f"platform: Σ ½ e'Se less c/N, {_both_sizes()}, next term allowed for",
        unexplained,
        STEERED_TRIALS - 1,
    )


def _rate_check(forms: Sequence[np.ndarray], predicted: PlatformExcess) -> Check:
    """Checks d log excess / d log N between both N."""
    few, many = STEERED_SAMPLES
    few_mean, many_mean = (form.mean() for form in forms)
    span = math.log(many / few)
    relative_error = standard_error(forms[1] / many_mean - forms[0] / few_mean)
    spread = quantile(1, STEERED_TRIALS - 1) * relative_error
    next_terms = predicted.next_term / np.array(STEERED_SAMPLES)
    return near(
        f"platform: slope of log excess over log N, {_both_sizes()}",
        math.log(many_mean / few_mean) / span,
        -1.0,
        (spread + next_terms[0]) / span,
        "1/N; standard errors, and the next term at the smaller N",
    )


def _limit_checks(
    forms: Sequence[np.ndarray], limited: Sequence[np.ndarray], predicted: PlatformExcess
) -> list[Check]:
    """Checks the excess for N -> infinity with each sensor."""
    few, many = STEERED_SAMPLES
    degrees = STEERED_TRIALS - 1
    limit = infinite_sample_excess(forms)
    limited_limit = infinite_sample_excess(limited)
    allowed = predicted.per_sample * predicted.next_term / few / many
    lowest = limited_limit.mean() - quantile(1, degrees) * standard_error(limited_limit)
    return [
        within_errors(
            f"platform: excess for N → ∞, {_both_sizes()}",
            limit.mean(),
            0.0,
            standard_error(limit),
            degrees,
            allowed,
        ),
        at_least(
            f"platform, sensor limited to {LIMIT:g}: the same, lower end",
            lowest,
            allowed,
            "a sensor that matches would have the next term left",
        ),
    ]


def _platform_panel(
    forms: Sequence[np.ndarray],
    limited: Sequence[np.ndarray],
    predicted: PlatformExcess,
    best: float,
) -> Panel:
    grid = np.geomspace(*STEERED_SAMPLES, 40)
    lines = [
        Line("c/N, predicted", grid.tolist(), list(100 * predicted.per_sample / grid / best)),
        _form_points("sensor chosen to match", forms, best),
        _form_points(f"the same, limited to {LIMIT:g}", limited, best),
    ]
    return Panel(
        "Excess cost of Algorithm 1, four states",
        "samples N",
        "excess cost (% of the optimum)",
        lines,
        "xy",
    )


def _form_points(label: str, forms: Sequence[np.ndarray], best: float) -> Line:
    """Returns means over trials with intervals, in per cent of the optimum."""
    means = np.array([form.mean() for form in forms])
    errors = np.array([standard_error(form) for form in forms])
    half_width = quantile(1, STEERED_TRIALS - 1) * errors
    low, high = (
        list(100 * end / best)
        for end in (np.maximum(means - half_width, means / 10), means + half_width)
    )
    return Line(label, list(STEERED_SAMPLES), list(100 * means / best), "points", low, high)
