"""Computes what a state-dependent noise level tells about the state, beside the measurement's mean.

One measurement y ~ N(c(x), R(x)) has the Fisher information C' R^-1 C from its mean and
1/2 tr(R^-1 dR_i R^-1 dR_j) from its noise level.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...belief.kalman import correct
from ...discretise import measurement_cov
from ...problem import Belief, Problem
from ...results.certificate import Check
from ..bands import rounding
from ..compilation import quick_jit
from .section_vii import (
    light_dark_numbers,
    light_dark_problem,
    problem_numbers,
)

NOISE_STATES = 64
SHORT_STEP = 1e-3  # s, a second step for the intensity


class FisherInformation(NamedTuple):
    """Holds the Fisher information about x in one measurement, each part (nx, nx)."""

    mean: Array  # from the mean of the measurement
    noise_level: Array  # from its covariance


def fisher_information(problem: Problem, x: Array) -> FisherInformation:
    """Returns the information about x (nx,) in one measurement."""
    R = measurement_cov(problem, x)
    dR = jax.jacfwd(lambda x: measurement_cov(problem, x))(x)
    C = jax.jacfwd(problem.system.c)(x)
    scaled = jnp.einsum("ab,bci->aci", jnp.linalg.inv(R), dR)
    return FisherInformation(
        C.T @ jnp.linalg.solve(R, C), 0.5 * jnp.einsum("abi,baj->ij", scaled, scaled)
    )


def one_step_problem(convention: str, dt: float) -> Problem:
    """Returns one step of the light-dark problem; `convention` says what sigma_o is."""
    return light_dark_problem(convention, jnp.zeros(4), jnp.ones(4), dt, steps=1)


def noise_level_checks(rng: np.random.Generator) -> list[Check]:
    """Returns checks of what the light-dark noise level tells, and that the EKF ignores it."""
    dt = problem_numbers()["dt"]
    problem = one_step_problem("sample", dt)
    position = rng.uniform(-1, 8, NOISE_STATES)
    states = np.column_stack([position, rng.normal(size=(NOISE_STATES, 3))])

    def measured(x: Array) -> tuple[FisherInformation, Array]:
        """Returns the information, and the EKF's covariance after a measurement, from I before."""
        correction = correct(problem, Belief(x, jnp.eye(4)), problem.system.c(x))
        return fisher_information(problem, x), correction.posterior.cov

    information, after = quick_jit(jax.vmap(measured))(states)

    # The noise level tells 4 slope^2 times the mean, over dt for an intensity.
    expected = 4 * light_dark_numbers()["noise_slope"] ** 2
    ratios = [noise_to_mean_ratio(information)]
    for step in (dt, SHORT_STEP):
        as_intensity = partial(fisher_information, one_step_problem("intensity", step))
        ratios.append(noise_to_mean_ratio(quick_jit(jax.vmap(as_intensity))(states)) * step)
    ratio_error = float(np.max(np.abs(np.array(ratios) / expected - 1)))

    # From a unit covariance, the condition number of the inverse is the size of its result.
    gained = np.linalg.inv(after) - np.eye(4) - information.mean
    size = np.linalg.norm(np.eye(4) + information.mean, 2, axis=(1, 2))
    excess = np.max(np.linalg.norm(gained, 2, axis=(1, 2)) / size**2)
    return [
        rounding(
            "noise level tells 4 slope² = 2 times the mean, or 2/dt: relative error",
            ratio_error,
            40,
        ),
        rounding("EKF: information gained besides the mean's, over (1 + the mean's)²", excess, 60),
    ]


def noise_to_mean_ratio(information: FisherInformation) -> np.ndarray:
    """Returns the information about p_x (M,) from the noise level over that from the mean."""
    mean, noise_level = (np.asarray(part)[:, 0, 0] for part in information)
    return noise_level / mean
