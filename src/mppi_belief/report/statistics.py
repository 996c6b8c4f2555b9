"""Intervals on averages and on paired differences, and z of our numbers against published ones.

A z is the difference of two numbers in standard errors of that difference. Both numbers are Monte
Carlo estimates: the published one from `published.PAPER_TRIALS` trials, ours from as many as were
run. For a mean and a standard deviation, z is the difference divided by its standard error (for the
standard deviation that of normal samples). For a proportion, z is the signed root of the likelihood
ratio of "two rates" against "one rate", which holds where one of the rates is zero.

Every interval here is at 95 % by itself. Of k comparisons of equal numbers at level a, k a are
expected to be significant by chance; Holm's (1979) adjusted p-values keep the probability of one or
more such errors among all k below a, whatever the dependence between the comparisons.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import betaincinv, chdtri, stdtrit, xlogy

RESAMPLES = 9999  # of the bootstrap


class Estimate(NamedTuple):
    """Holds a value with its confidence interval; NaN stands for a part that does not exist."""

    value: float
    low: float
    high: float

    def times(self, factor: float) -> "Estimate":
        """Converts to another unit: multiplies the value and both ends by `factor`."""
        return Estimate(*(factor * part for part in self))


NO_ESTIMATE = Estimate(math.nan, math.nan, math.nan)


def mean_interval(values: np.ndarray, level: float = 0.95) -> Estimate:
    """Returns the sample mean of values (n,) with Student's t interval.

    The interval is NaN for fewer than two values and where a value is not finite.
    """
    values = np.asarray(values, dtype=float)
    if len(values) == 0 or not np.all(np.isfinite(values)):
        return NO_ESTIMATE._replace(value=float(np.mean(values)) if len(values) else math.nan)
    center = float(np.mean(values))
    if len(values) == 1:
        return NO_ESTIMATE._replace(value=center)
    quantile = stdtrit(len(values) - 1, (1 + level) / 2)
    half_width = float(quantile * np.std(values, ddof=1) / np.sqrt(len(values)))
    return Estimate(center, center - half_width, center + half_width)


def chi_square_band(freedom: float, level: float = 0.95) -> Estimate:
    """Returns the band that holds the mean of `freedom` squared standard normals.

    It holds it with probability `level`. The value of the estimate is the expectation, 1.
    """
    tails = ((1 + level) / 2, (1 - level) / 2)
    low, high = (float(chdtri(freedom, tail)) / freedom for tail in tails)
    return Estimate(1.0, low, high)


def proportion_interval(successes: int, trials: int, level: float = 0.95) -> Estimate:
    """Returns a proportion with the exact interval of Clopper and Pearson (1934)."""
    if trials == 0:
        return NO_ESTIMATE
    tail = (1 - level) / 2
    failures = trials - successes
    low = float(betaincinv(successes, failures + 1, tail)) if successes else 0.0
    high = float(betaincinv(successes + 1, failures, 1 - tail)) if failures else 1.0
    return Estimate(successes / trials, low, high)


def paired_mean_difference(first: np.ndarray, second: np.ndarray, level: float = 0.95) -> Estimate:
    """Returns the mean of first - second over pairs (n,), with its bootstrap interval.

    The interval is the bias-corrected and accelerated one (Efron 1987). It is NaN for fewer than
    three pairs, and has no width where all pairs differ by the same amount.
    """
    from scipy.stats import bootstrap  # takes half a second to import

    difference = np.asarray(first, dtype=float) - np.asarray(second, dtype=float)
    value = float(np.mean(difference)) if len(difference) else math.nan
    if len(difference) < 3:
        return NO_ESTIMATE._replace(value=value)
    if np.ptp(difference) == 0:
        return Estimate(value, value, value)
    result = bootstrap(
        (difference,),
        np.mean,
        confidence_level=level,
        n_resamples=RESAMPLES,
        rng=np.random.default_rng(0),
    )
    interval = result.confidence_interval
    return Estimate(value, float(interval.low), float(interval.high))


def paired_rate_difference(
    first: np.ndarray, second: np.ndarray, level: float = 0.95
) -> tuple[Estimate, float]:
    """Returns the difference of two rates over pairs of bool (n,), and McNemar's exact p-value.

    The difference is (2 s - 1) d, with d the part of the pairs that differ and s the part of those
    in which only the first is true. The interval spans the values of this product over the exact
    intervals of both factors. It therefore excludes zero where the test rejects, and covers at
    least as often as its level says (measured: 0.97 and more for 0.95).
    """
    first = np.asarray(first, dtype=bool)
    second = np.asarray(second, dtype=bool)
    pairs = len(first)
    only_first = int(np.sum(first & ~second))
    only_second = int(np.sum(second & ~first))
    differ = only_first + only_second
    if pairs == 0:
        return NO_ESTIMATE, math.nan

    # The extremes of (2 s - 1) d over the intervals of d and s.
    d = proportion_interval(differ, pairs, level)
    s = proportion_interval(only_first, differ, level) if differ else Estimate(0.5, 0.0, 1.0)
    corners = np.outer([2 * s.low - 1, 2 * s.high - 1], [d.low, d.high])
    difference = (only_first - only_second) / pairs
    p_value = _sign_test(only_first, only_second) if differ else 1.0
    return Estimate(difference, float(corners.min()), float(corners.max())), p_value


def _sign_test(wins: int, losses: int) -> float:
    """Returns the two-sided p-value of wins against losses under even odds."""
    from scipy.stats import binomtest

    return float(binomtest(wins, wins + losses).pvalue)


def two_sided_p(z: float) -> float:
    """Returns the probability that a standard normal is at least as far from 0 as z."""
    return math.erfc(abs(z) / math.sqrt(2))


def holm_adjusted(p_values: Sequence[float]) -> list[float]:
    """Returns Holm's (1979) adjusted p-values of a family of tests, in the given order.

    The k-th smallest of m p-values is multiplied by m - k + 1, and never falls below a smaller one.
    NaN stands for a test without a result; it stays NaN and does not count.
    """
    p = np.asarray(p_values, dtype=float)
    tested = np.flatnonzero(~np.isnan(p))
    order = tested[np.argsort(p[tested], kind="stable")]
    factors = np.arange(len(order), 0, -1)
    adjusted = np.full(len(p), np.nan)
    adjusted[order] = np.minimum(np.maximum.accumulate(factors * p[order]), 1.0)
    return [float(value) for value in adjusted]


def lowest_apart(estimates: Sequence[Estimate]) -> int | None:
    """Returns the index of the estimate whose interval lies below the intervals of all others.

    Intervals that touch count as overlapping. None where no interval lies apart, where one does
    not exist, and of fewer than two estimates.
    """
    if len(estimates) < 2 or any(math.isnan(part) for part in np.ravel(estimates)):
        return None
    index = min(range(len(estimates)), key=lambda i: estimates[i].value)
    others = [estimate.low for i, estimate in enumerate(estimates) if i != index]
    return index if estimates[index].high < min(others) else None


def mean_z(
    mean: float, sd: float, n: int, published_mean: float, published_sd: float, published_n: int
) -> float:
    """Returns z of a mean against a published mean, NaN where neither has a spread."""
    error = math.sqrt(sd**2 / n + published_sd**2 / published_n)
    return (mean - published_mean) / error if error else math.nan


def spread_z(sd: float, n: int, published_sd: float, published_n: int) -> float:
    """Returns z of a standard deviation against a published one, NaN where both are zero.

    The variance of a standard deviation s of n normal samples is s^2 / (2 (n - 1)).
    """
    error = math.sqrt(sd**2 / (2 * (n - 1)) + published_sd**2 / (2 * (published_n - 1)))
    return (sd - published_sd) / error if error else math.nan


def proportion_z(hits: float, n: int, published_hits: float, published_n: int) -> float:
    """Returns z of the proportion hits / n against the published one."""
    rate = hits / n
    published_rate = published_hits / published_n
    pooled = (hits + published_hits) / (n + published_n)
    gain = _log_likelihood(hits, n, rate)
    gain += _log_likelihood(published_hits, published_n, published_rate)
    gain -= _log_likelihood(hits, n, pooled)
    gain -= _log_likelihood(published_hits, published_n, pooled)
    return math.copysign(math.sqrt(max(2 * gain, 0.0)), rate - published_rate)


def _log_likelihood(hits: float, n: int, rate: float) -> float:
    """Returns the log likelihood of `hits` among `n` at this rate, without its constant."""
    return float(xlogy(hits, rate) + xlogy(n - hits, 1 - rate))
