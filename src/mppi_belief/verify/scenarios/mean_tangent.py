"""The part of a measurement's diffusion outside the tangent space of the Gaussian means (7).

    c(x) - E c = A(mu) (x - mu)  for all mu     if and only if     c(x) = A x + b             (7)

Under N(mu, s^2), with a = exp(-s^2), the part of c outside the tangent space and A(mu) are

    c = x^3     (18 mu^2 s^4 + 6 s^6) / (9 mu^4 s^2 + 36 mu^2 s^4 + 15 s^6)     3 (mu^2 + s^2)
    c = sin x   1 - A^2 s^2 / ((1 - a)^2 / 2 + cos^2(mu) a (1 - a))             cos(mu) sqrt(a)

from the Hermite coefficients of c; the second denominator is Var[sin x], written without
cancellation.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...matching.affine import outside_mean_tangent
from ...numerics.quadrature import gaussian_nodes
from ..compilation import quick_jit

S = 0.5  # s, standard deviation of the scalar beliefs
Observation = Callable[[Array], Array]


class TangentFit(NamedTuple):
    """Holds the least-squares fit of one observation over M means."""

    part: np.ndarray  # (M,), the part of c outside the tangent space
    A: np.ndarray  # (M, ny, nx), the gradient of the fit
    operations: int  # roundings behind each entry


def tangent_fits(
    observations: Sequence[Observation],
    means: np.ndarray,
    cov: np.ndarray,
    per_axis: int | None = None,
) -> list[TangentFit]:
    """Returns `outside_mean_tangent` of each observation over means (M, nx) and one cov (nx, nx).

    All observations are compiled as one program. `per_axis` is the number of quadrature nodes per
    axis.
    """
    nodes = gaussian_nodes(cov.shape[0], per_axis)

    def fit(index: Array, mean: Array) -> tuple[Array, Array]:
        return outside_mean_tangent(
            lambda x: jax.lax.switch(index, observations, x), mean, jnp.asarray(cov), nodes
        )

    index = jnp.arange(len(observations)).repeat(len(means))
    fit_all = quick_jit(lambda *pairs: jax.lax.map(lambda pair: fit(*pair), pairs))
    results = fit_all(index, np.tile(means, (len(observations), 1)))
    parts, gradients = (np.split(np.asarray(result), len(observations)) for result in results)
    # Two sums over the nodes for the gradient and one for the mean; the products at a node count
    # less than another sum.
    operations = 4 * len(nodes[1])
    return [TangentFit(part, A, operations) for part, A in zip(parts, gradients, strict=True)]


def cubic_part(mu: np.ndarray) -> np.ndarray:
    """Returns the part of x^3 outside the tangent space (M,)."""
    return (18 * mu**2 * S**4 + 6 * S**6) / cubic_variance(mu)


def cubic_variance(mu: np.ndarray) -> np.ndarray:
    """Returns Var[x^3] (M,)."""
    return 9 * mu**4 * S**2 + 36 * mu**2 * S**4 + 15 * S**6


def cubic_mean_square(mu: np.ndarray) -> np.ndarray:
    """Returns E[x^6] (M,)."""
    return mu**6 + 15 * mu**4 * S**2 + 45 * mu**2 * S**4 + 15 * S**6


def sine_part(mu: np.ndarray) -> np.ndarray:
    """Returns the part of sin x outside the tangent space (M,).

    It is least at mu = 0, where it is 1 - s^2 / sinh(s^2).
    """
    a = np.exp(-(S**2))
    return 1 - S**2 * a * np.cos(mu) ** 2 / sine_variance(np.cos(mu) ** 2)


def sine_variance(cosine_squared: np.ndarray) -> np.ndarray:
    """Returns Var[sin x] (M,) for cos^2(mu) (M,)."""
    a = np.exp(-(S**2))
    one_minus_a = -np.expm1(-(S**2))
    return one_minus_a**2 / 2 + a * one_minus_a * cosine_squared


def distance_and_bearing(x: Array) -> Array:
    """Returns distance and direction of a point (2,) from the origin."""
    return jnp.array([jnp.sqrt(x @ x), jnp.arctan2(x[1], x[0])])


def affine_observation(A: np.ndarray, b: np.ndarray, x: Array) -> Array:
    """Returns A x + b (ny,)."""
    return jnp.asarray(A) @ x + b
