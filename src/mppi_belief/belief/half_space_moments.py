"""Moments of a function of the distance to half-spaces, under a Gaussian position.

    h(p) = sum_j f(y_j),    y_j = n_j' p - o_j ~ N(m_j, s_j^2)

Each distance is a Gaussian number, so mean and variance of each term have closed forms
(`DistanceMoments`). Two terms are correlated as their distances are:

    Cov[f(y_i), f(y_j)] = sum_k w_k f(y_ik) (E[f(y_j) | y_i = y_ik] - E[f(y_j)])

with the nodes y_ik of `belief.interval_rule` where f(y_i) is not zero and a closed form for the
conditional mean. The covariance with a quadratic q of Hessian W and gradient g at the mean follows
from Stein's lemma, with the covariance c_j of the state with y_j:

    Cov[q, f(y_j)] = c_j' g dE/dm + 1/2 c_j' W c_j d^2E/dm^2,     E(m) = E[f(y_j)]

Symbols: n half-spaces, d components of the position.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ..numerics.linalg import dot
from .interval_rule import Number, interval_nodes, regular_sd

N_PAIR_NODES = 16  # of the distance to the first of two half-spaces
FAR = 1e6  # of the deviations and the reach: stands for the infinite depth of a half-space
CLOSEST_CORRELATION = 1 - 1e-6  # beyond it two distances count as this much correlated


class DistanceMoments(NamedTuple):
    """Holds the moments of f(y), y ~ N(m, s^2); every field is ()."""

    mean: Array  # E = E[f]
    variance: Array
    slope: Array  # dE/dm
    curvature: Array  # d^2E/dm^2


class HalfSpaceDistances(NamedTuple):
    """Holds the distribution of the distances to half-spaces."""

    mean: Array  # (n,)
    cov: Array  # (n, n)


OfDistance = Callable[[Array, Array], DistanceMoments]  # of m and s


def half_space_moments(
    profile: Callable[[Array], Array],
    reach: Number,
    of_distance: OfDistance,
    distances: HalfSpaceDistances,
) -> tuple[Array, Array]:
    """Returns expectation and variance, both (), of the sum over half-spaces.

    Args:
        profile: f
        reach: from which distance on f is zero
        of_distance: the moments of f for one distance
        distances: to the half-spaces
    """
    mean, cov = distances
    n = len(mean)
    sds = [regular_sd(cov[j, j], 1.0) for j in range(n)]
    each = [of_distance(mean[j], sds[j]) for j in range(n)]
    expectation = sum((m.mean for m in each[1:]), each[0].mean)
    variance = sum((m.variance for m in each[1:]), each[0].variance)
    for i in range(n):
        for j in range(i):
            pair = jnp.stack([sds[i], sds[j], cov[i, j]])
            variance += 2 * _pair_covariance(profile, reach, of_distance, (mean[i], mean[j]), pair)
    return expectation, jnp.maximum(variance, 0.0)


def _pair_covariance(
    profile: Callable[[Array], Array],
    reach: Number,
    of_distance: OfDistance,
    means: tuple[Array, Array],
    spread: Array,
) -> Array:
    """Returns the covariance () of two terms, from both deviations and their covariance."""
    sd, sd_other, cov = spread
    limit = CLOSEST_CORRELATION
    correlation = jnp.clip(cov / (sd * sd_other), -limit, limit)
    rest = sd_other * jnp.sqrt(1 - correlation**2)
    low = jnp.minimum(means[0] - FAR * sd, reach - sd)
    nodes = interval_nodes(low, reach, means[0], sd, N_PAIR_NODES)

    def of_node(point: Array) -> Array:
        shifted = means[1] + correlation * sd_other * (point - means[0]) / sd
        return of_distance(shifted, rest).mean

    points = jnp.stack(nodes.points)
    unconditional = of_distance(means[1], sd_other).mean
    gaps = jax.vmap(of_node)(points) - unconditional
    values = jax.vmap(profile)(points)
    return nodes.probability * jnp.sum(jnp.stack(nodes.fractions) * values * gaps)


def quadratic_covariance(
    of_distance: OfDistance,
    distances: HalfSpaceDistances,
    directions: Array,
    gradient: list[Array],
    weight: Array,
) -> Array:
    """Returns the covariance () of the sum with a quadratic.

    Args:
        of_distance: the moments of f for one distance
        distances: to the half-spaces
        directions: c_j (n, nx), the covariance of the state with each distance
        gradient: g (nx,) of the quadratic at the mean
        weight: W (nx, nx)
    """
    total = jnp.zeros_like(distances.mean[0])
    for j, direction in enumerate(directions):
        moments = of_distance(distances.mean[j], regular_sd(distances.cov[j, j], 1.0))
        curvature = direction @ weight @ direction
        total += dot(direction, gradient) * moments.slope + 0.5 * curvature * moments.curvature
    return total
