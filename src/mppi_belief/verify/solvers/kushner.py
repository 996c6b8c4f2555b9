"""The Kushner-Stratonovich equation on a line, by splitting (Sec. III).

    dpi     = L* pi dt + pi (c - pi(c)) R_o^-1 dy~,      dy~ = dy - pi(c) dt              (5)
    a^u(pi) = -((f + G u) pi)' + Q pi'' / 2                                              (6a)
    b(pi)   = pi (c - pi(c)) R_o^-1                                                      (6b)

A step dt is a Crank-Nicolson step of (6a), in finite volumes of second order in h that conserve the
mass, followed by Bayes' rule for the increment dy: pi times exp(c dy / R_o - c^2 dt / 2 R_o),
normalised. Both halves are better than first order, but their Lie splitting is not: the error is
O(dt) + O(h^2). A symmetric splitting would not improve the mean either: the splitting does not know
how an increment arrived within its step, which matters by O(dt) over a path.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

from ...discretise import measurement_intensity
from ...problem import Problem

Reals = NDArray[np.float64]


class StateGrid(NamedTuple):
    """Holds cells of equal width on a line."""

    x: Reals  # (n,), centres
    h: float  # width


class Coefficients(NamedTuple):
    """Holds a system with one state, control and measurement on a grid."""

    f: Reals  # (n,), drift
    G: Reals  # (n,), control channel
    Q: float  # process noise intensity
    c: Reals  # (n,), or (n, P) where it differs from column to column
    R_o: float  # measurement noise intensity


class Moments(NamedTuple):
    """Holds means and variances of P beliefs at t_0..t_T."""

    mean: Reals  # (T+1, P)
    variance: Reals  # (T+1, P)


def state_grid(low: float, high: float, cells: int) -> StateGrid:
    """Returns `cells` cells between `low` and `high`."""
    h = (high - low) / cells
    return StateGrid(np.asarray(low + h * (np.arange(cells) + 0.5)), h)


def coefficients(problem: Problem, grid: StateGrid) -> Coefficients:
    """Returns a problem with nx = nu = ny = 1 on a grid.

    Its measurement noise must not depend on the state.
    """
    system = problem.system
    points = jnp.asarray(grid.x)[:, None]
    f, G, c = (
        np.asarray(jax.vmap(function)(points)).reshape(len(points))
        for function in (system.f, system.G, system.c)
    )
    R_o = measurement_intensity(problem, points[0])
    return Coefficients(f, G, (system.H @ system.H.T).item(), c, R_o.item())


def gaussian_density(grid: StateGrid, mean: float, variance: float) -> Reals:
    """Returns the density (n,) of N(mean, variance), normalised on the grid."""
    p = np.exp(-((grid.x - mean) ** 2) / (2 * variance))
    return np.asarray(p / (p.sum() * grid.h))


def fokker_planck_bands(grid: StateGrid, model: Coefficients, u: float) -> Reals:
    """Returns L* as a tridiagonal matrix in banded form (3, n), without flux through the ends.

    The flux through a face is the mean of (f + G u) pi over its two cells less Q / 2 times the
    gradient of pi. With that, d E[x] = E[f + G u] dt and d E[x^2] = (2 E[x (f + G u)] + Q) dt hold
    on the grid as they do on the line.
    """
    half_drift = (model.f + model.G * u) / 2
    diffusion = model.Q / (2 * grid.h)
    flux_from_below = (diffusion + half_drift[:-1]) / grid.h
    flux_from_above = (half_drift[1:] - diffusion) / grid.h
    bands = np.zeros((3, len(grid.x)))
    bands[0, 1:] = -flux_from_above
    bands[2, :-1] = flux_from_below
    bands[1, :-1] -= flux_from_below
    bands[1, 1:] += flux_from_above
    return bands


def drift_channel(bands: Reals, p: Reals) -> Reals:
    """Returns a^u(pi) of (6a) for densities (n, P); `bands` (3, n) is the generator."""
    rate = bands[1, :, None] * p
    rate[:-1] += bands[0, 1:, None] * p[1:]
    rate[1:] += bands[2, :-1, None] * p[:-1]
    return rate


def diffusion_channel(grid: StateGrid, p: Reals, c: Reals, R_o: float) -> Reals:
    """Returns b(pi) of (6b) for densities (n, P) and c (n, 1) or (n, P)."""
    return np.asarray(p * (c - np.sum(p * c, axis=0) * grid.h) / R_o)


def transport(bands: Reals, p: Reals, dt: float) -> Reals:
    """Returns densities (n, P) after a Crank-Nicolson step of the Fokker-Planck equation."""
    implicit = -dt / 2 * bands
    implicit[1] += 1
    explicit = p + dt / 2 * drift_channel(bands, p)
    return np.asarray(solve_banded((1, 1), implicit, explicit, check_finite=False))


def observe(grid: StateGrid, p: Reals, c: Reals, R_o: float, dy: Reals, dt: float) -> Reals:
    """Returns densities (n, P) after Bayes' rule for increments dy (P,) and c (n, 1) or (n, P)."""
    exponent = (c * dy - c**2 * (dt / 2)) / R_o
    p = p * np.exp(exponent - exponent.max(axis=0))
    return np.asarray(p / (p.sum(axis=0) * grid.h))


def density_moments(grid: StateGrid, p: Reals) -> tuple[Reals, Reals]:
    """Returns mean and variance (P,) of densities (n, P)."""
    mean = grid.x @ p * grid.h
    return mean, np.sum((grid.x[:, None] - mean) ** 2 * p, axis=0) * grid.h


def solve_kushner(
    grid: StateGrid,
    model: Coefficients,
    prior: Reals,
    controls: Reals,
    increments: Reals,
    dt: float,
    substeps: int = 1,
) -> Moments:
    """Returns the filter's moments along P paths.

    The inputs are a prior density (n,), controls (T,) and measurement increments dy (T, P).
    `substeps` Crank-Nicolson steps precede each increment.
    """
    p = np.repeat(prior[:, None], increments.shape[1], axis=1)
    c = model.c.reshape(len(grid.x), -1)
    history = [density_moments(grid, p)]
    for u, dy in zip(controls, increments, strict=True):
        bands = fokker_planck_bands(grid, model, u)
        for _ in range(substeps):
            p = transport(bands, p, dt / substeps)
        p = observe(grid, p, c, model.R_o, dy, dt)
        history.append(density_moments(grid, p))
    mean, variance = (np.array(part) for part in zip(*history, strict=True))
    return Moments(mean, variance)


def extrapolated_moments(coarse: Moments, fine: Moments) -> Moments:
    """Returns Richardson's extrapolation of a scheme of second order.

    The fine grid has cells half as wide as those of the coarse grid.
    """
    return Moments(*((4 * f - c) / 3 for c, f in zip(coarse, fine, strict=True)))
