"""From (1a)(1b) to time steps: Euler-Maruyama and the one place that knows what sigma_o means.

    x_{k+1} = x_k + (f(x_k) + G(x_k) u_k) dt + H w_k,      w_k ~ N(0, I dt)           (18)
    y_k     = c(x_k) + v_k,                                v_k ~ N(0, R_s(x_k))

A measurement is the increment of (1b) over a step divided by dt, so its covariance R_s and the
intensity R_o of the continuous theory obey R_o = R_s dt. A system's `noise_convention` says which
of the two its sigma_o gives: "sample": R_s = sigma_o sigma_o'; "intensity": R_o = sigma_o sigma_o'.
"""

from collections.abc import Callable

import jax.numpy as jnp
from jax import Array

from .problem import System, WrappedMeasurements


def euler_step(system: System, x: Array, u: Array, dt: Array | float) -> Array:
    """The noise-free step of (18): x (nx,), u (nu,) -> (nx,)."""
    return x + (system.f(x) + system.G(x) @ u) * dt


def measurement_factor(system: System, x: Array, dt: Array | float) -> Array:
    """F with F F' = R_s(x): v = F n for standard normal n; (ny, ny)."""
    scale = 1.0 if system.noise_convention == "sample" else 1.0 / jnp.sqrt(dt)
    return system.sigma_o(x) * scale


def measurement_cov(system: System, x: Array, dt: Array | float) -> Array:
    """Covariance R_s of one measurement at x (ny, ny)."""
    factor = measurement_factor(system, x, dt)
    return factor @ factor.T


def measurement_difference(system: System, y: Array, predicted: Array) -> Array:
    """How far the measurement y (ny,) is from the predicted one (ny,): the only such comparison.

    The system's own `difference` if it has one (`WrappedMeasurements`), otherwise y - predicted.
    """
    if isinstance(system, WrappedMeasurements):
        return system.difference(y, predicted)
    return y - predicted


def unwrapped_measurement(system: System, center: Array) -> Callable[[Array], Array]:
    """c without the jumps of wrapped measurements, x (nx,) -> (ny,), continuous around `center`."""
    if not isinstance(system, WrappedMeasurements):
        return system.c
    middle = system.c(center)
    return lambda x: middle + measurement_difference(system, system.c(x), middle)


def measurement_intensity(system: System, x: Array, dt: Array | float) -> Array:
    """Intensity R_o = R_s dt of the continuous measurement (1b) at x (ny, ny)."""
    return measurement_cov(system, x, dt) * dt
