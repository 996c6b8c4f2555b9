"""Intervals on what trials show, and on differences between two methods that met the same noise."""

from typing import NamedTuple

import numpy as np
from scipy.special import betaincinv, chdtri, stdtrit

RESAMPLES = 9999


class Estimate(NamedTuple):
    """A value with its confidence interval."""

    value: float
    low: float
    high: float

    def times(self, factor: float) -> "Estimate":
        """In another unit."""
        return Estimate(*(factor * part for part in self))


NO_ESTIMATE = Estimate(float("nan"), float("nan"), float("nan"))


def mean_interval(values: np.ndarray, level: float = 0.95) -> Estimate:
    """Sample mean with Student's t interval; an interval of NaN for fewer than two values."""
    values = np.asarray(values, dtype=float)
    if len(values) == 0 or not np.all(np.isfinite(values)):
        return NO_ESTIMATE._replace(value=float(np.mean(values)) if len(values) else float("nan"))
    center = float(np.mean(values))
    if len(values) == 1:
        return NO_ESTIMATE._replace(value=center)
    half = float(
        stdtrit(len(values) - 1, (1 + level) / 2) * np.std(values, ddof=1) / np.sqrt(len(values))
    )
    return Estimate(center, center - half, center + half)


def chi_square_band(freedom: float, level: float = 0.95) -> Estimate:
    """Where the mean of so many squared standard normals lies with that probability, around its expectation 1."""
    low, high = (
        float(chdtri(freedom, tail)) / freedom for tail in ((1 + level) / 2, (1 - level) / 2)
    )
    return Estimate(1.0, low, high)


def proportion_interval(successes: int, trials: int, level: float = 0.95) -> Estimate:
    """Proportion with the exact interval of Clopper and Pearson (1934)."""
    if trials == 0:
        return NO_ESTIMATE
    tail, failures = (1 - level) / 2, trials - successes
    low = float(betaincinv(successes, failures + 1, tail)) if successes else 0.0
    high = float(betaincinv(successes + 1, failures, 1 - tail)) if failures else 1.0
    return Estimate(successes / trials, low, high)


def paired_mean_difference(first: np.ndarray, second: np.ndarray, level: float = 0.95) -> Estimate:
    """Mean of first - second over pairs (n,), with the bias-corrected accelerated bootstrap interval
    (Efron 1987); NaN for fewer than three pairs, no width where all pairs differ alike."""
    from scipy.stats import bootstrap  # half a second to import

    difference = np.asarray(first, dtype=float) - np.asarray(second, dtype=float)
    value = float(np.mean(difference)) if len(difference) else float("nan")
    if len(difference) < 3:
        return NO_ESTIMATE._replace(value=value)
    if np.ptp(difference) == 0:
        return Estimate(value, value, value)
    found = bootstrap(
        (difference,),
        np.mean,
        confidence_level=level,
        n_resamples=RESAMPLES,
        rng=np.random.default_rng(0),
    )
    return Estimate(
        value, float(found.confidence_interval.low), float(found.confidence_interval.high)
    )


def paired_rate_difference(
    first: np.ndarray, second: np.ndarray, level: float = 0.95
) -> tuple[Estimate, float]:
    """Rate of first - rate of second over pairs of bool (n,), and the p-value of McNemar's exact test.

    The difference is (2 s - 1) d, with d the part of the pairs that differ and s the part of those in which only
    the first is true. The interval spans what it can be over the exact intervals of both, so it leaves out
    zero where the test rejects, and covers at least as often as it says (measured: 0.97 and more for 0.95).
    """
    first, second = np.asarray(first, dtype=bool), np.asarray(second, dtype=bool)
    n, only_first, only_second = (
        len(first),
        int(np.sum(first & ~second)),
        int(np.sum(second & ~first)),
    )
    differ = only_first + only_second
    if n == 0:
        return NO_ESTIMATE, float("nan")
    often = proportion_interval(differ, n, level)
    share = proportion_interval(only_first, differ, level) if differ else Estimate(0.5, 0.0, 1.0)
    ends = [(2 * s - 1) * d for s in share[1:] for d in often[1:]]
    p = _sign_test(only_first, only_second) if differ else 1.0
    return Estimate((only_first - only_second) / n, min(ends), max(ends)), p


def _sign_test(wins: int, losses: int) -> float:
    """Two-sided p of wins against losses under even odds."""
    from scipy.stats import binomtest

    return float(binomtest(wins, wins + losses).pvalue)
