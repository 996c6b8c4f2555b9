"""A rule for expectations of functions of a Gaussian number that vanish outside an interval.

    E[f(y) 1(a < y < b)] = P(a < y < b) sum_i c_i f(y_i),   y ~ N(m, s^2)

The nodes y_i are those of Gauss and Legendre on the part of the interval that has nearly all of the
probability in it, and the fractions c_i are proportional to their weights times the density. They
are positive and sum to one, and the probability is exact. So a function that is constant on the
interval has no error, whatever the ratio of s to the interval, and no variance is negative.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.scipy.special import erfc

WIDTH = 6.0  # standard deviations; beyond lies less than 1e-8 of the probability of an interval
# The least standard deviation by that size, times the root of the machine precision: smaller ones
# do not differ from zero by more than rounding.
LEAST_SPREAD = 0.03

LEAST_EXPONENT = -60.0  # of a density over its peak

Number = Array | float


class IntervalNodes(NamedTuple):
    """Holds the nodes of an interval."""

    points: list[Array]  # y_i, each ()
    fractions: list[Array]  # c_i, each (), which sum to 1
    probability: Array  # of the interval, ()


def interval_nodes(low: Number, high: Number, mean: Array, sd: Array, count: int) -> IntervalNodes:
    """Returns the nodes for y ~ N(mean, sd^2), sd > 0, on the interval from low to high."""
    start, end, peak = covered_range(low, high, mean, sd)
    abscissae, shares = np.polynomial.legendre.leggauss(count)
    middle = 0.5 * (start + end)
    half = 0.5 * (end - start)
    points = [middle + float(point) * half for point in abscissae]
    weights = [
        float(weight) * density_ratio(point, peak, mean, sd)
        for weight, point in zip(shares, points, strict=True)
    ]
    total = sum(weights[1:], weights[0])
    fractions = [weight / total for weight in weights]
    return IntervalNodes(points, fractions, interval_probability(low, high, mean, sd))


def covered_range(low: Number, high: Number, mean: Array, sd: Array) -> tuple[Array, Array, Array]:
    """Returns start and end of the part of an interval with nearly all of its probability.

    The third number is the point of the interval with the highest density.
    """
    peak = jnp.clip(mean, low, high)
    extent = sd * jnp.sqrt(((peak - mean) / sd) ** 2 + WIDTH**2)
    return jnp.maximum(mean - extent, low), jnp.minimum(mean + extent, high), peak


def density_ratio(point: Array, peak: Array, mean: Array, sd: Array) -> Array:
    """Returns the density of N(mean, sd^2) at a point over that at the peak.

    It is at most 1 and never zero, so that rounding far from the mean gives no quotient 0 / 0.
    """
    exponent = -0.5 * ((point - peak) / sd) * ((point - mean + peak - mean) / sd)
    return jnp.exp(jnp.clip(exponent, LEAST_EXPONENT, 0.0))


def interval_probability(low: Number, high: Number, mean: Array, sd: Array) -> Array:
    """Returns P(low < y < high) of y ~ N(mean, sd^2), as a difference of the smaller tails."""
    below = (low - mean) / sd
    above = (high - mean) / sd
    mirrored = below + above > 0
    return normal_cdf(jnp.where(mirrored, -below, above)) - normal_cdf(
        jnp.where(mirrored, -above, below)
    )


def normal_cdf(z: Array) -> Array:
    """Returns the probability that a standard normal is below z, accurate far below zero."""
    return 0.5 * erfc(-float(np.sqrt(0.5)) * z)


def normal_pdf(z: Array) -> Array:
    """Returns the density of a standard normal at z."""
    return jnp.exp(-0.5 * z * z) / float(np.sqrt(2 * np.pi))


def regular_sd(variance: Array, size: Number) -> Array:
    """Returns a standard deviation () that is not zero, for functions that vary over `size`."""
    least = LEAST_SPREAD * float(np.sqrt(jnp.finfo(variance.dtype).eps)) * size
    return jnp.sqrt(jnp.maximum(variance, least * least))
