"""From (1a)(1b) to time steps: Euler-Maruyama and the one place that knows what sigma_o means.

    x_{k+1} = x_k + (f(x_k) + G(x_k) u_k) dt + H w_k,      w_k ~ N(0, I dt)           (18)
    y_k     = c(x_k) + v_k,                                v_k ~ N(0, R_s(x_k))

A measurement is the increment of (1b) over a step divided by dt, so its covariance R_s and the
intensity R_o of the continuous theory obey R_o = R_s dt. A problem's `noise_convention` says which
of the two its sigma_o gives: "sample": R_s = sigma_o sigma_o'; "intensity": R_o = sigma_o sigma_o'.
"""

from collections.abc import Callable

import jax.numpy as jnp
from jax import Array

from .problem import Problem, System, WrappedMeasurements


def euler_step(system: System, x: Array, u: Array, dt: Array | float) -> Array:
    """Returns the noise-free step of (18): x (nx,), u (nu,) -> (nx,)."""
    return x + (system.f(x) + system.G(x) @ u) * dt


def measurement_factor(problem: Problem, x: Array) -> Array:
    """Returns F (ny, ny) with F F' = R_s(x): the noise is v = F n for standard normal n."""
    scale = 1.0 if problem.noise_convention == "sample" else 1.0 / jnp.sqrt(problem.dt)
    return problem.system.sigma_o(x) * scale


def measurement_cov(problem: Problem, x: Array) -> Array:
    """Returns the covariance R_s (ny, ny) of one measurement at x (nx,)."""
    factor = measurement_factor(problem, x)
    return factor @ factor.T


def measurement_intensity(problem: Problem, x: Array) -> Array:
    """Returns the intensity R_o = R_s dt (ny, ny) of the continuous measurement (1b) at x (nx,)."""
    return measurement_cov(problem, x) * problem.dt


def measurement_difference(system: System, y: Array, predicted: Array) -> Array:
    """Returns the measurement y (ny,) less the predicted one (ny,): the only such comparison.

    It is the system's own `difference` if it has one (`WrappedMeasurements`), else y - predicted.
    """
    if isinstance(system, WrappedMeasurements):
        return system.difference(y, predicted)
    return y - predicted


def unwrapped_measurement(system: System, center: Array) -> Callable[[Array], Array]:
    """Returns c without the jumps of wrapped measurements, (nx,) -> (ny,), around `center`."""
    if not isinstance(system, WrappedMeasurements):
        return system.c
    middle = system.c(center)
    return lambda x: middle + measurement_difference(system, system.c(x), middle)
