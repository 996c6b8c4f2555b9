"""Intervals on what trials show."""

from typing import NamedTuple

import numpy as np
from scipy.special import betaincinv, stdtrit


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
    half = float(stdtrit(len(values) - 1, (1 + level) / 2) * np.std(values, ddof=1) / np.sqrt(len(values)))
    return Estimate(center, center - half, center + half)


def proportion_interval(successes: int, trials: int, level: float = 0.95) -> Estimate:
    """Proportion with the exact interval of Clopper and Pearson (1934)."""
    if trials == 0:
        return Estimate(float("nan"), float("nan"), float("nan"))
    tail, failures = (1 - level) / 2, trials - successes
    low = float(betaincinv(successes, failures + 1, tail)) if successes else 0.0
    high = float(betaincinv(successes + 1, failures, 1 - tail)) if failures else 1.0
    return Estimate(successes / trials, low, high)
