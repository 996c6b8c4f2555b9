"""Computes estimates of cells and draws them as a line through points with 95 % intervals."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ..cell_results import CellResults
from ..statistics import NO_ESTIMATE, Estimate, mean_interval, proportion_interval
from .style import Look


def collision_rate(cell: CellResults) -> Estimate:
    """Returns the collision rate of the good trials in %, with Clopper and Pearson's interval."""
    collided = cell.collided
    return proportion_interval(int(collided.sum()), len(collided)).times(100)


def mean_of(column: str) -> Callable[[CellResults], Estimate]:
    """Returns a function that takes the mean of a column of the good rows, with Student's interval.

    Values that are not finite are left out.
    """

    def estimate(cell: CellResults) -> Estimate:
        values = cell.good[column].to_numpy(dtype=float)
        return mean_interval(values[np.isfinite(values)])

    return estimate


def step_time(cell: CellResults) -> Estimate:
    """Returns the median time of a control step in ms.

    The interval is that of the order statistics n / 2 +- 1.96 sqrt(n) / 2.
    """
    times = 1e3 * np.sort(np.asarray(cell.seconds, dtype=float))
    n = len(times)
    if n == 0:
        return NO_ESTIMATE
    reach = math.ceil(1.96 * math.sqrt(n) / 2)
    low = n // 2 - reach
    high = (n - 1) // 2 + reach
    median = float(np.median(times))
    if low < 0:
        return NO_ESTIMATE._replace(value=median)
    return Estimate(median, times[low], times[high])


def draw_estimates(
    axes: Axes, x: Sequence[float], estimates: Sequence[Estimate], look: Look, **more: Any
) -> None:
    """Draws estimates at x (n,) with their intervals; `more` overrides the style of the line.

    Estimates without a value are left out; those without an interval have no bar.
    """
    value, low, high = np.array(estimates, dtype=float).reshape(-1, 3).T
    finite = np.isfinite(value)
    bars = np.maximum([value - low, high - value], 0)[:, finite]
    style = {"color": look.colour, "marker": look.marker, "ls": look.line}
    style |= {"elinewidth": 0.8, "capsize": 1.5}
    positions = np.asarray(x, dtype=float)[finite]
    axes.errorbar(positions, value[finite], yerr=bars, capthick=0.8, **(style | more))


def dodge(x: Sequence[float], index: int, count: int, ratio: float = 1.045) -> list[float]:
    """Shifts x (> 0) for line `index` of `count`, so that bars do not hide each other.

    The shifts are even on a log axis.
    """
    return [value * ratio ** (index - (count - 1) / 2) for value in x]
