"""Estimates of cells and how they are drawn: points with 95 % intervals, a line through them."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ..cell_results import CellResults
from ..statistics import NO_ESTIMATE, Estimate, mean_interval, proportion_interval
from .style import Look


def collision_rate(found: CellResults) -> Estimate:
    """Of the good trials, in %, with the interval of Clopper and Pearson."""
    hits = found.collided
    return proportion_interval(int(hits.sum()), len(hits)).times(100)


def mean_of(column: str) -> Callable[[CellResults], Estimate]:
    """The mean of a column of the good rows, of its finite values, with Student's interval."""

    def estimate(found: CellResults) -> Estimate:
        values = found.good[column].to_numpy(dtype=float)
        return mean_interval(values[np.isfinite(values)])

    return estimate


def step_time(found: CellResults) -> Estimate:
    """The median time of a control step, in ms; the interval is that of order statistics, n / 2 +- 1.96 sqrt(n) / 2."""
    times = 1e3 * np.sort(np.asarray(found.seconds, dtype=float))
    n = len(times)
    if n == 0:
        return NO_ESTIMATE
    reach = math.ceil(1.96 * math.sqrt(n) / 2)
    low, high = n // 2 - reach, (n - 1) // 2 + reach
    median = float(np.median(times))
    return (
        Estimate(median, times[low], times[high])
        if low >= 0
        else NO_ESTIMATE._replace(value=median)
    )


def draw_estimates(
    axes: Axes, x: Sequence[float], estimates: Sequence[Estimate], look: Look, **more: Any
) -> None:
    """Points at x with their intervals; those without a value are left out, those without an interval have no bar."""
    value, low, high = np.array(estimates, dtype=float).reshape(-1, 3).T
    there = np.isfinite(value)
    bars = np.maximum([value - low, high - value], 0)[:, there]
    style = {
        "color": look.colour,
        "marker": look.marker,
        "ls": look.line,
        "elinewidth": 0.8,
        "capsize": 1.5,
    } | more
    axes.errorbar(np.asarray(x, dtype=float)[there], value[there], yerr=bars, capthick=0.8, **style)


def dodge(x: Sequence[float], index: int, of: int, ratio: float = 1.045) -> list[float]:
    """x (> 0) moved for the line `index` among `of`, evenly on a log axis, so that bars do not hide each other."""
    return [value * ratio ** (index - (of - 1) / 2) for value in x]
