"""Theorem 1 and Proposition 2: whether f and c are affine, and whether G and sigma_o are constant.

All functions are examined around the trial, as far as the prior and the trial's means spread.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...belief.prior import prior
from ...belief.schedule import gain_schedule
from ...discretise import unwrapped_measurement
from ...matching.affine import outside_mean_tangent
from ...numerics.quadrature import gaussian_nodes
from ...problem import Problem
from ...results.certificate import Check
from ..bands import rounding
from .trial_path import TrialPath, schedule_operations

EXAMINED_MEANS = 8  # along the trial
LEAST_SPREAD = 1e-3  # of a state that neither the prior nor the trial moves


class AffineFit(NamedTuple):
    """Holds the least-squares affine fit of a function at P means."""

    part: Array  # (P,), the part of the function outside the mean tangent space
    A: Array  # (P, n, nx), the gradient of the fit
    value: Array  # (P, n), the function at the means


def affine_conditions(problem: Problem, path: TrialPath) -> list[Check]:
    """Returns the conditions of Theorem 1 and Proposition 2 around the trial."""
    means = np.asarray(path.schedule.mean)
    prior_std = np.sqrt(np.diag(prior(problem).cov))
    spread = np.maximum(np.maximum(prior_std, means.std(axis=0)), LEAST_SPREAD)
    examined = means[np.linspace(0, len(means) - 1, EXAMINED_MEANS).astype(int)]
    cov = np.diag(spread**2)
    states = examined + spread * np.random.default_rng(0).normal(size=examined.shape)
    measurement_fit, drift_fit = jax.tree.map(
        np.asarray, _affine_fits(problem, examined, cov, *gaussian_nodes(len(spread)))
    )
    sigma_o, G = jax.tree.map(np.asarray, _noise_and_channel(problem, states))
    return [
        _affine_check(
            "Theorem 1: part of c outside the mean tangent space, 0 if c is affine",
            measurement_fit,
            cov,
        ),
        _constant_check(
            "Theorem 1: relative change of sigma_o over the states, 0 if constant", sigma_o
        ),
        _affine_check("Proposition 2: part of f that is not affine", drift_fit, cov),
        _constant_check("Proposition 2: relative change of G over the states", G),
        _independence_check(problem, path),
    ]


@jax.jit
def _affine_fits(
    problem: Problem, means: Array, cov: Array, points: Array, weights: Array
) -> tuple[AffineFit, AffineFit]:
    """Returns the fits of c and of f at means (P, nx).

    Measurements that wrap are unwrapped around each mean.
    """
    system = problem.system
    nodes = (points, weights)

    def fit(function_around: Callable[[Array], Callable[[Array], Array]]) -> AffineFit:
        parts, A = jax.lax.map(
            lambda mean: outside_mean_tangent(function_around(mean), mean, cov, nodes), means
        )
        return AffineFit(parts, A, jax.vmap(lambda mean: function_around(mean)(mean))(means))

    return fit(lambda mean: unwrapped_measurement(system, mean)), fit(lambda mean: system.f)


@jax.jit
def _noise_and_channel(problem: Problem, states: Array) -> tuple[Array, Array]:
    """Returns sigma_o (P, ny, ny) and G (P, nx, nu) at states (P, nx)."""
    return jax.vmap(problem.system.sigma_o)(states), jax.vmap(problem.system.G)(states)


def _affine_check(computed: str, fit: AffineFit, cov: np.ndarray) -> Check:
    """Checks the part outside at the mean where its root is largest against its rounding."""
    part, A, value = (np.asarray(field) for field in fit)
    deviation = np.sqrt(np.einsum("pij,jk,pik->p", A, cov, A))
    # A constant function has no part outside.
    scale = 1 + np.linalg.norm(value, axis=-1) / np.maximum(deviation, 1e-300)
    roots = np.sqrt(part)
    worst = int(np.argmax(roots / scale))
    operations = 4 * len(gaussian_nodes(len(cov))[1])
    return rounding(computed, roots[worst], operations, scale=float(scale[worst]))


def _constant_check(computed: str, values: np.ndarray) -> Check:
    largest = float(np.max(np.abs(values), initial=0.0))
    change = float(np.max(np.abs(values - values[0]), initial=0.0))
    return rounding(computed, change / largest if largest else 0.0, operations=4)


def _independence_check(problem: Problem, path: TrialPath) -> Check:
    """Checks the covariances under controls of the trial's size against those without control."""
    u = path.controls
    size = 1.0 + jnp.max(jnp.abs(u), axis=0)
    controls = jnp.stack(
        [jnp.zeros_like(u), jnp.broadcast_to(size, u.shape), jnp.broadcast_to(-size, u.shape)]
    )
    covs = _covariances(problem, controls)
    largest = float(jnp.max(jnp.abs(covs[0])))
    change = float(jnp.max(jnp.abs(covs - covs[0])))
    return rounding(
        "Proposition 2: relative change of Sigma_t with the controls, 0 if none",
        change / largest if largest else change,
        operations=schedule_operations(problem),
    )


@jax.jit
def _covariances(problem: Problem, controls: Array) -> Array:
    """Returns Sigma (C, T+1, nx, nx) for C sequences of controls (C, T, nu)."""
    return jax.vmap(lambda u: gain_schedule(problem, prior(problem), u, "riccati").cov)(controls)
