"""EKF and particle filter on a curved measurement, c(x) = x + kappa x^2 / 2.

For small kappa the extended Kalman filter errs

* in its mean by O(kappa), since it omits kappa Sigma / 2 in pi(c);
* in its variance by O(kappa), since it omits what (6b) does to the variance, kappa Sigma^2 R_o^-1
  dy~.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...filters import EKF, ParticleFilter
from ...problem import Problem
from ...results.certificate import Check
from ...simulate import FILTER, role_key
from ..bands import at_least, largest_z, order
from ..compilation import quick_jit
from ..estimates import rms
from ..solvers import kushner
from ..solvers.kushner import Moments, Reals, extrapolated_moments
from .linear_filtering import rms_over
from .scalar_paths import (
    STATE_REACH,
    CurvedMeasurement,
    filter_moments,
    grid_filter_moments,
    simulated_measurements,
    uncosted_problem,
)

CURVED_STEPS = 32
CURVED_PATHS = 64
PARTICLES = 500
SETTLED_STEPS = 8  # after which the prior is forgotten
CURVATURES = (0.01, 0.02, 0.04, 0.08, 0.4, 1.6)  # kappa
SMALL_CURVATURES = slice(3, None, -1)  # of CURVATURES, those that show the order
PARTICLE_CURVATURES = [3, 4, 5]  # of CURVATURES, those of the particle filter


class CurvedResults(NamedTuple):
    """Holds moments of three filters on the same paths."""

    ekf: Moments  # (curvatures, P, T+1)
    particles: Moments  # (len(PARTICLE_CURVATURES), P, T+1)
    exact: Moments  # (curvatures, P, T+1), of the grid filter, extrapolated
    grid_error: Moments  # (curvatures, P, T+1), of the grid filter


def curved_problem(curvature: Array | float) -> Problem:
    """Returns the problem with a curved measurement."""
    return uncosted_problem(CurvedMeasurement(curvature, 0.5, 0.3), 1.0, CURVED_STEPS)


def curved_results(seed: int) -> CurvedResults:
    """Returns the moments of the filters for every curvature, on paths of the same noise."""

    def measured_ekf(curvature: Array, path: Array) -> tuple[Array, tuple[Array, Array]]:
        problem = curved_problem(curvature)
        y = simulated_measurements(problem, seed, path)
        return y, filter_moments(problem, EKF(), y, jax.random.key(0))

    def particle_moments(curvature: Array, path: Array, y: Array) -> tuple[Array, Array]:
        particle_filter = ParticleFilter(PARTICLES, resample_below=0.5, noise_at="particle")
        key = role_key(seed, path, FILTER)
        return filter_moments(curved_problem(curvature), particle_filter, y, key)

    # Over curvatures and paths.
    curvatures = jnp.array(CURVATURES)
    paths = jnp.arange(CURVED_PATHS)
    chosen = jnp.array(PARTICLE_CURVATURES)
    run_ekf = quick_jit(jax.vmap(jax.vmap(measured_ekf, (None, 0)), (0, None)))
    y, ekf = run_ekf(curvatures, paths)
    run_particles = quick_jit(jax.vmap(jax.vmap(particle_moments, (None, 0, 0)), (0, None, 0)))
    particles = run_particles(curvatures[chosen], paths, y[chosen])

    coarse, fine = (
        curved_grid_moments(np.asarray(y)[..., 0], cells, substeps)
        for cells, substeps in ((250, 1), (500, 2))
    )
    exact = extrapolated_moments(coarse, fine)
    return CurvedResults(
        ekf=Moments(*map(np.asarray, ekf)),
        particles=Moments(*map(np.asarray, particles)),
        exact=exact,
        grid_error=Moments(*(np.abs(e - f) for e, f in zip(exact, fine, strict=True))),
    )


def curved_grid_moments(y: Reals, cells: int, substeps: int) -> Moments:
    """Returns the grid filter's moments, each (curvatures, P, T+1).

    The measurements y are (curvatures, P, T).
    """
    problem = curved_problem(0.0)
    x = kushner.state_grid(-STATE_REACH, STATE_REACH, cells).x[:, None]
    c = x + np.repeat(CURVATURES, y.shape[1]) * x**2 / 2
    dy = y.reshape(-1, CURVED_STEPS).T * problem.dt
    moments = grid_filter_moments(problem, cells, dy, c, substeps)
    return Moments(*(part.T.reshape(*y.shape[:2], -1) for part in moments))


def particle_check(results: CurvedResults) -> Check:
    """Returns the check of the particle filter's mean error over time, averaged over the paths.

    Its bias of O(1 / particles) is a small part of the standard error, O(1 / root(particles
    paths)).
    """
    std = np.sqrt(results.exact.variance[PARTICLE_CURVATURES])
    scores = []
    for sampled, exact, grid_error, unit in zip(
        results.particles, results.exact, results.grid_error, (std, std**2), strict=True
    ):
        deviation = (sampled - exact[PARTICLE_CURVATURES]) / unit
        grid_bound = grid_error[PARTICLE_CURVATURES] / unit
        path_means = deviation[:, :, SETTLED_STEPS:].mean(axis=2)
        path_bounds = grid_bound[:, :, SETTLED_STEPS:].mean(axis=2)
        error = path_means.std(axis=1, ddof=1) / np.sqrt(CURVED_PATHS)
        unexplained = np.abs(path_means.mean(axis=1)) - path_bounds.mean(axis=1)
        scores.append(np.maximum(unexplained, 0) / error)
    return largest_z(
        f"particle filter, {PARTICLES} particles: mean and variance against the grid, "
        f"over {CURVED_PATHS} paths",
        scores,
        CURVED_PATHS - 1,
    )


def ekf_checks(ekf: Moments, exact: Moments, grid_error: Moments) -> list[Check]:
    """Returns checks of how the EKF's errors grow with kappa, and that they are not the grid's."""
    means, variances = (
        rms_over(approximate - truth, axis=(1, 2))[SMALL_CURVATURES]
        for approximate, truth in zip(ekf, exact, strict=True)
    )
    std = np.sqrt(exact.variance[-1])
    largest_error = float(rms((ekf.mean - exact.mean)[-1] / std))
    floor = float(rms(grid_error.mean[-1] / std))
    return [
        order("order in κ of the error of the EKF's mean", 1, list(means)),
        order("order in κ of the error of the EKF's variance", 1, list(variances)),
        at_least(
            f"RMS error of the EKF's mean at κ = {CURVATURES[-1]:g}, × posterior sd",
            largest_error,
            floor,
            "the grid's own error, from halving h and dt",
        ),
    ]
