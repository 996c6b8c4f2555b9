"""The Kushner-Stratonovich equation on a line, by splitting (Sec. III).

    dpi     = L* pi dt + pi (c - pi(c)) R_o^-1 dy~,      dy~ = dy - pi(c) dt              (5)
    a^u(pi) = -((f + G u) pi)' + Q pi'' / 2                                              (6a)
    b(pi)   = pi (c - pi(c)) R_o^-1                                                      (6b)

A step dt is a Crank-Nicolson step of (6a), in finite volumes of second order in h that keep the mass, and
then Bayes' rule for the increment dy: pi times exp(c dy / R_o - c^2 dt / 2 R_o), normalised. Both halves are
better than first order, their Lie splitting is not: the error is O(dt) + O(h^2). Nor would a symmetric
splitting help the mean: how an increment arrived within its step is lost, and matters by O(dt) over a path.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

from ..discretise import measurement_intensity
from ..problem import Problem

Reals = NDArray[np.float64]


class Grid(NamedTuple):
    """Centres x (n,) of cells of equal width h."""

    x: Reals
    h: float


class Coefficients(NamedTuple):
    """A system with one state, control and measurement on a grid: f, G (n,), Q (), c (n,), or (n, P) where it
    differs from column to column, R_o ()."""

    f: Reals
    G: Reals
    Q: float
    c: Reals
    R_o: float


class Moments(NamedTuple):
    """Mean and variance at t_0..t_T, each (T+1, P)."""

    mean: Reals
    variance: Reals


def grid(low: float, high: float, cells: int) -> Grid:
    """`cells` cells between `low` and `high`."""
    h = (high - low) / cells
    return Grid(np.asarray(low + h * (np.arange(cells) + 0.5)), h)


def coefficients(problem: Problem, on: Grid) -> Coefficients:
    """A problem with nx = nu = ny = 1 on a grid; its measurement noise must not depend on the state."""
    system = problem.system
    points = jnp.asarray(on.x)[:, None]
    f, G, c = (
        np.asarray(jax.vmap(part)(points)).reshape(len(points))
        for part in (system.f, system.G, system.c)
    )
    R_o = measurement_intensity(problem, points[0])
    return Coefficients(f, G, (system.H @ system.H.T).item(), c, R_o.item())


def gaussian(on: Grid, mean: float, variance: float) -> Reals:
    """The density (n,) of N(mean, variance), its mass on the grid one."""
    p = np.exp(-((on.x - mean) ** 2) / (2 * variance))
    return np.asarray(p / (p.sum() * on.h))


def generator(on: Grid, model: Coefficients, u: float) -> Reals:
    """L* as a tridiagonal matrix in banded form (3, n); nothing flows through the ends.

    The flux through a face is the mean of its cells' (f + G u) pi less Q / 2 times their slope. With that
    d E[x] = E[f + G u] dt and d E[x^2] = (2 E[x (f + G u)] + Q) dt hold on the grid as they do on the line.
    """
    drift, spread = (model.f + model.G * u) / 2, model.Q / (2 * on.h)
    from_left, from_right = (spread + drift[:-1]) / on.h, (drift[1:] - spread) / on.h
    bands = np.zeros((3, len(on.x)))
    bands[0, 1:], bands[2, :-1] = -from_right, from_left
    bands[1, :-1] -= from_left
    bands[1, 1:] += from_right
    return bands


def drift_channel(bands: Reals, p: Reals) -> Reals:
    """a^u(pi) of (6a) for densities (n, P), `bands` the generator (3, n)."""
    rate = bands[1, :, None] * p
    rate[:-1] += bands[0, 1:, None] * p[1:]
    rate[1:] += bands[2, :-1, None] * p[:-1]
    return rate


def diffusion_channel(on: Grid, p: Reals, c: Reals, R_o: float) -> Reals:
    """b(pi) of (6b) for densities (n, P) and c (n, 1) or (n, P)."""
    return np.asarray(p * (c - np.sum(p * c, axis=0) * on.h) / R_o)


def transport(bands: Reals, p: Reals, dt: float) -> Reals:
    """A Crank-Nicolson step of the Fokker-Planck equation for densities (n, P)."""
    implicit = -dt / 2 * bands
    implicit[1] += 1
    return np.asarray(
        solve_banded((1, 1), implicit, p + dt / 2 * drift_channel(bands, p), check_finite=False)
    )


def observe(on: Grid, p: Reals, c: Reals, R_o: float, dy: Reals, dt: float) -> Reals:
    """Bayes' rule for increments dy (P,), densities (n, P) and c (n, 1) or (n, P)."""
    exponent = (c * dy - c**2 * (dt / 2)) / R_o
    p = p * np.exp(exponent - exponent.max(axis=0))
    return np.asarray(p / (p.sum(axis=0) * on.h))


def moments(on: Grid, p: Reals) -> tuple[Reals, Reals]:
    """Mean and variance (P,) of densities (n, P)."""
    mean = on.x @ p * on.h
    return mean, np.sum((on.x[:, None] - mean) ** 2 * p, axis=0) * on.h


def solve(
    on: Grid,
    model: Coefficients,
    start: Reals,
    controls: Reals,
    increments: Reals,
    dt: float,
    substeps: int = 1,
) -> Moments:
    """The filter's moments for a prior (n,), controls (T,) and P paths of increments dy (T, P).

    `substeps` Crank-Nicolson steps are made before each increment.
    """
    p = np.repeat(start[:, None], increments.shape[1], axis=1)
    c = model.c.reshape(len(on.x), -1)
    found = [moments(on, p)]
    for u, dy in zip(controls, increments, strict=True):
        bands = generator(on, model, u)
        for _ in range(substeps):
            p = transport(bands, p, dt / substeps)
        p = observe(on, p, c, model.R_o, dy, dt)
        found.append(moments(on, p))
    mean, variance = (np.array(part) for part in zip(*found, strict=True))
    return Moments(mean, variance)


def extrapolated(coarse: Moments, fine: Moments) -> Moments:
    """Richardson's value of a scheme of second order from two grids, one twice as fine as the other."""
    return Moments(*((4 * f - c) / 3 for c, f in zip(coarse, fine, strict=True)))
