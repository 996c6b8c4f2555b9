"""How far a measured number is from a published one, in standard errors of the difference.

Both sides are Monte Carlo estimates: the published one from `published.TRIALS` trials, ours from as many
as were run. For a mean and a standard deviation z is the difference over its standard error (for the
latter that of normal samples); for a proportion it is the signed root of the likelihood ratio of "two
rates" against "one rate", which holds where one of them is zero.
"""

import math

from scipy.special import xlogy


def mean_z(mean: float, sd: float, n: int, other: float, other_sd: float, other_n: int) -> float:
    """z of one mean against another, NaN where neither side has a spread."""
    error = math.sqrt(sd**2 / n + other_sd**2 / other_n)
    return (mean - other) / error if error else math.nan


def spread_z(sd: float, n: int, other: float, other_n: int) -> float:
    """z of one standard deviation against another; the variance of s is s^2 / (2 (n - 1)). NaN as for means."""
    error = math.sqrt(sd**2 / (2 * (n - 1)) + other**2 / (2 * (other_n - 1)))
    return (sd - other) / error if error else math.nan


def proportion_z(hits: float, n: int, other: float, other_n: int) -> float:
    """z of one proportion, hits of n, against another."""
    pooled = (hits + other) / (n + other_n)
    gain = _likelihood(hits, n, hits / n) + _likelihood(other, other_n, other / other_n)
    gain -= _likelihood(hits, n, pooled) + _likelihood(other, other_n, pooled)
    return math.copysign(math.sqrt(max(2 * gain, 0.0)), hits / n - other / other_n)


def _likelihood(hits: float, n: int, rate: float) -> float:
    """Log likelihood of hits among n, less its constant."""
    return float(xlogy(hits, rate) + xlogy(n - hits, 1 - rate))
