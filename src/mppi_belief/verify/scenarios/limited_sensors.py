"""Rotated sensors with a limit, at covariances of a matched schedule: what they leave of (15)."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...belief.riccati import kalman_bucy_gain
from ...matching.sensor import matching_sensor
from ...matching.weights import matched_weight, residual
from ...problem import Problem
from ...results.certificate import Check, Line, Panel
from ..bands import EPSILON, at_most, rounding
from ..compilation import quick_jit
from .sensing_systems import SENSING_TEMPERATURE, SensingSchedule, rounding_scale

LIMITS = np.append(np.geomspace(0.1, 30.0, 12), 1e6)  # of the sensor; the last is no limit
SHOWN_TIMES = (0, 2, 8)  # indices of the covariances whose residuals are drawn


def limited_sensor_results(
    sensing: SensingSchedule, rng: np.random.Generator
) -> tuple[list[Check], Panel]:
    """Returns checks and figure of rotated sensors with a limit, at covariances of the schedule."""
    rotation, _ = np.linalg.qr(rng.normal(size=(2, 2)))
    covs = sensing.schedule.cov[1::8]
    residuals = np.asarray(_limited_residuals(sensing.problem, rotation, LIMITS, covs))
    operations, condition = rounding_scale([sensing])
    checks = [
        rounding(
            "4 states, continuous, rotated sensor, no limit: residual of (15)",
            np.max(residuals[-1]),
            operations,
            condition,
        ),
        at_most(
            "the same: largest relative rise of the residual as the limit grows from 0.1",
            np.max(np.diff(residuals, axis=0) / residuals[:-1]),
            operations * EPSILON * condition,
            "rounding: D grows with the limit in the order of matrices",
        ),
    ]
    times = sensing.problem.dt * (1 + 8 * np.arange(residuals.shape[1]))
    lines = [
        Line(f"t = {times[k]:.1f}", LIMITS[5:-1].tolist(), residuals[5:-1, k].tolist())
        for k in SHOWN_TIMES
    ]
    panel = Panel(
        "What a limited sensor leaves of (15)",
        "largest signal-to-noise ratio of the sensor",
        "residual ε",
        lines,
        "x",
    )
    return checks, panel


@quick_jit
def _limited_residuals(problem: Problem, rotation: Array, limits: Array, covs: Array) -> Array:
    """Returns residuals (limits, covariances) of the continuous D."""
    G = problem.system.G(problem.prior_mean)
    noise = problem.system.sigma_o(problem.prior_mean)
    rotated = noise @ rotation @ jnp.linalg.inv(noise)

    def limited_residual(limit: Array, cov: Array) -> Array:
        C = rotated @ matching_sensor(
            jnp.linalg.cholesky(cov), G, problem.cost.R, SENSING_TEMPERATURE, noise, 0.0, limit
        )
        _, D = kalman_bucy_gain(cov, C, noise @ noise.T)
        return residual(D, G, matched_weight(problem.cost.R, SENSING_TEMPERATURE))

    over_covs = jax.vmap(limited_residual, (None, 0))
    return jax.vmap(over_covs, (0, None))(limits, covs)
