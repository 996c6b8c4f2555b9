"""Intervals on what trials show."""

from typing import NamedTuple

import numpy as np
from scipy import stats


class Estimate(NamedTuple):
    """A value with its confidence interval."""

    value: float
    low: float
    high: float


def mean_interval(values: np.ndarray, level: float = 0.95) -> Estimate:
    """Sample mean with Student's t interval; an interval of NaN for fewer than two values."""
    values = np.asarray(values, dtype=float)
    if len(values) == 0 or not np.all(np.isfinite(values)):
        return Estimate(float(np.mean(values)) if len(values) else float("nan"), float("nan"), float("nan"))
    center = float(np.mean(values))
    if len(values) == 1:
        return Estimate(center, float("nan"), float("nan"))
    half = float(stats.t.ppf((1 + level) / 2, len(values) - 1) * np.std(values, ddof=1) / np.sqrt(len(values)))
    return Estimate(center, center - half, center + half)


def proportion_interval(successes: int, trials: int, level: float = 0.95) -> Estimate:
    """Proportion with the exact interval of Clopper and Pearson (1934)."""
    if trials == 0:
        return Estimate(float("nan"), float("nan"), float("nan"))
    found = stats.binomtest(successes, trials).proportion_ci(level, method="exact")
    return Estimate(successes / trials, float(found.low), float(found.high))
