"""Algorithm 1 end to end: closed loops of the algorithm as printed against optimal control.

`scenarios.stationary_scalar` derives what both must cost: J* for LQG and J* + a + c/N for N
samples.
"""

import math
from collections.abc import Sequence

import numpy as np

from ...controllers import LQG
from ...problem import Problem
from ...results.certificate import Certificate, Check, Line, Panel
from ..bands import at_most, largest_z, near, quantile, rounding, within_errors
from ..estimates import largest_magnitude, standard_error
from ..scenarios.scalar_loops import (
    ScalarLoops,
    closed_loops,
    control_error_form,
    receding_algorithm,
)
from ..scenarios.stationary_scalar import (
    CONTROL_GAIN,
    SCALAR_DT,
    SCALAR_HORIZON,
    SCALAR_STEPS,
    SCALAR_TEMPERATURE,
    PredictedExcess,
    ScalarOptimum,
    filter_law,
    predicted_excess,
    scalar_optimal_cost,
    stationary_problem,
    weighted_paths,
)

SAMPLES = (16, 64, 256, 1024)  # N
TRIALS = 400
OPTIMAL_TRIALS = 4000  # of LQG


def certify(seed: int = 0) -> Certificate:
    """Returns the certificate: closed loops of LQG and of Algorithm 1 for growing N, same noise."""
    problem, optimum = stationary_problem()
    covs, innovations = filter_law(problem)
    best = scalar_optimal_cost(problem, optimum, covs)
    predicted = predicted_excess(problem, optimum, covs, innovations)

    lqg = closed_loops(problem, LQG(horizon=0, at_step_end=False), seed, OPTIMAL_TRIALS)
    loops = [
        closed_loops(problem, receding_algorithm(samples), seed, TRIALS) for samples in SAMPLES
    ]
    forms = np.array([control_error_form(optimum, loop) for loop in loops])
    paired = np.array([loop.cost - lqg.cost[:TRIALS] for loop in loops])
    return Certificate(
        "algorithm_1",
        "Algorithm 1 end to end",
        _excess_text(predicted, best),
        [
            *optimum_checks(problem, optimum, best, lqg),
            *excess_checks(paired, forms, predicted, best),
        ],
        [_excess_panel(paired, forms, predicted, best), _loop_panel(loops, lqg)],
    )


def optimum_checks(
    problem: Problem, optimum: ScalarOptimum, best: float, lqg: ScalarLoops
) -> list[Check]:
    """Returns checks that LQG and the exact expectation of (19) for a matched D are optimal."""
    D = SCALAR_TEMPERATURE * CONTROL_GAIN**2 / float(problem.cost.R[0, 0])
    matched = weighted_paths(np.full((1, SCALAR_HORIZON), D), optimum.value, SCALAR_TEMPERATURE)
    gain = matched.pull[0] / (CONTROL_GAIN * SCALAR_DT)
    control_gap = largest_magnitude(lqg.control + optimum.gain * lqg.mean)
    trials = len(lqg.cost)
    return [
        rounding(
            "algebra of (19), nothing sampled: its K at D = λb²/R by NumPy, "
            "less SciPy's Riccati gain",
            gain - optimum.gain,
            10 * SCALAR_HORIZON,
        ),
        rounding(
            "largest |u + K μ| of LQG, K stationary",
            control_gap,
            20 * SCALAR_STEPS,
            largest_magnitude(lqg.mean),
        ),
        within_errors(
            f"cost of LQG, {trials} trials, against the closed form",
            float(np.mean(lqg.cost)),
            best,
            standard_error(lqg.cost),
            trials - 1,
        ),
    ]


def excess_checks(
    paired: np.ndarray, forms: np.ndarray, predicted: PredictedExcess, best: float
) -> list[Check]:
    """Returns checks of the paired excess and the quadratic forms (samples, trials)."""
    samples = np.array(SAMPLES)
    degrees = forms.shape[1] - 1
    fewest = SAMPLES[0]
    most = SAMPLES[-1]

    # Excess less quadratic form is a martingale.
    martingale = paired - forms
    martingale_z = martingale.mean(axis=1) / [standard_error(row) for row in martingale]

    # The quadratic form is a + c/N, up to the next term.
    means = forms.mean(axis=1)
    errors = np.array([standard_error(form) for form in forms])
    next_terms = predicted.per_sample / samples * predicted.next_term / samples
    unexplained = np.maximum(np.abs(means - predicted.excess(samples)) - next_terms, 0)
    upper_end = means[-1] + quantile(1, degrees) * errors[-1]
    return [
        largest_z(
            f"excess over LQG less Σ ½ S e_k², N = {fewest} to {most}", martingale_z, degrees
        ),
        largest_z(
            f"Σ ½ S e_k² less a + c/N, N = {fewest} to {most}, next term allowed for",
            unexplained / errors,
            degrees,
        ),
        _slope_check(forms, predicted),
        _floor_check(forms, predicted),
        at_most(
            f"excess at N = {most}, % of the optimum, upper end",
            100 * upper_end / best,
            100 * predicted.excess(most / 2) / best,
            "a + 2c/N: what half as many samples must cost",
        ),
    ]


def _slope_check(forms: np.ndarray, predicted: PredictedExcess) -> Check:
    """Checks d log(excess - a) / d log N from the second N to the last."""
    few = forms[1] - predicted.floor
    many = forms[-1] - predicted.floor
    span = math.log(SAMPLES[-1] / SAMPLES[1])
    slope = math.log(many.mean() / few.mean()) / span
    error = standard_error(many / many.mean() - few / few.mean()) / span
    tolerance = quantile(1, len(few) - 1) * error + predicted.next_term / SAMPLES[1] / span
    return near(
        f"slope of log(excess - a) over log N, N = {SAMPLES[1]} to {SAMPLES[-1]}",
        slope,
        -1.0,
        tolerance,
        "1/N; standard errors, and the next term at the smaller N",
    )


def _floor_check(forms: np.ndarray, predicted: PredictedExcess) -> Check:
    """Checks the excess for N -> infinity, extrapolated from the last two N."""
    ratio = SAMPLES[-1] / SAMPLES[-2]
    limits = (ratio * forms[-1] - forms[-2]) / (ratio - 1)
    bias = predicted.per_sample * predicted.next_term / SAMPLES[-1] / SAMPLES[-2]
    return within_errors(
        f"excess for N → ∞, from N = {SAMPLES[-2]} and {SAMPLES[-1]}, against a",
        float(limits.mean()),
        predicted.floor,
        standard_error(limits),
        len(limits) - 1,
        float(bias),
    )


def _excess_text(predicted: PredictedExcess, best: float) -> str:
    return (
        "Algorithm 1 as printed was run in closed loop on a scalar system that is matched at the "
        "steady state of (8b), against LQG with the same noise. Its excess cost equals the "
        "quadratic form of its control errors and falls as 1/N, at the rate that Gaussian "
        f"integrals predict; {100 * predicted.floor / best:.2f} % of the optimum remains for N → "
        "∞, because the filter of a sampled measurement settles O(Δt) off that steady state. With "
        "D = λb²/R at every step, (19) is the discrete LQG control for any Δt: that check is "
        "algebra and uses no sampling code. The problem has one state and a quadratic cost: the "
        "certificate does not cover several states, or systems where the matching condition fails."
    )


def _excess_panel(
    paired: np.ndarray, forms: np.ndarray, predicted: PredictedExcess, best: float
) -> Panel:
    grid = np.geomspace(SAMPLES[0], SAMPLES[-1], 60)
    floor = 100 * predicted.floor / best
    lines = [
        Line("a + c/N, predicted", list(grid), list(100 * predicted.excess(grid) / best)),
        Line("a: N → ∞", [SAMPLES[0], SAMPLES[-1]], [floor, floor], "dashed"),
        excess_points("cost less that of LQG, same noise", paired, best),
        excess_points("quadratic form of the control errors", forms, best),
    ]
    return Panel(
        "Excess cost of Algorithm 1", "samples N", "excess cost (% of the optimum)", lines, "xy"
    )


def excess_points(label: str, excess: np.ndarray, best: float) -> Line:
    """Returns means over trials with intervals, in per cent of the optimum, for a logarithmic axis.

    Intervals that reach below zero end at a tenth of the mean, and means below zero are left out.
    `excess` is (samples, trials).
    """
    means = excess.mean(axis=1)
    degrees = excess.shape[1] - 1
    errors = np.array([standard_error(row) for row in excess])
    half_width = errors * quantile(1, degrees)
    bottom = np.where(half_width < means, means - half_width, means / 10)
    per_cent = 100 * np.array([means, bottom, means + half_width]) / best
    x, y, low, high = (list(values[means > 0]) for values in (np.array(SAMPLES), *per_cent))
    return Line(label, x, y, "points", low, high)


def _loop_panel(loops: Sequence[ScalarLoops], lqg: ScalarLoops) -> Panel:
    times = list(SCALAR_DT * np.arange(SCALAR_STEPS))
    lines = [
        Line(f"Algorithm 1, N = {SAMPLES[i]}", times, list(loops[i].mean[0])) for i in (0, 2, -1)
    ]
    lines.append(Line("LQG", times, list(lqg.mean[0]), "dashed"))
    return Panel("One closed loop, the same noise", "time t (s)", "belief mean μ", lines)
