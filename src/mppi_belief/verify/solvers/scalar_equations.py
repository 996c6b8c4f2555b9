"""The equations of the belief mean in one dimension, and what their solvers share.

    -dV/dt   = min_u q + 1/2 R u^2 + (f + G u) V_mu + 1/2 D V_mumu                   (13)
    -dPsi/dt = -q / lambda Psi + f Psi_mu + 1/2 D Psi_mumu,   Psi(T) = exp(-phi / lambda)      (16)

Here f = a mu, and everything else is constant in time. Far from the obstacles the costs are
quadratic, and V is that of a linear-quadratic problem, whose coefficients solve scalar Riccati
equations.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.integrate import OdeSolution, solve_ivp

CostFunction = Callable[[np.ndarray], np.ndarray]


class Quadratic(NamedTuple):
    """Holds constant + slope mu + curvature mu^2 / 2; the coefficients share any shape."""

    constant: float
    slope: float
    curvature: float


class ScalarEquation(NamedTuple):
    """Holds the terms of (13) and (16)."""

    drift: float  # a
    diffusion: float  # D
    authority: float  # G R^-1 G'
    temperature: float  # lambda
    duration: float  # T
    reach: float  # half width of the grids, where the costs are those far from the obstacles
    running: CostFunction  # q at means (n,)
    terminal: CostFunction  # phi at means (n,)
    far_running: Quadratic  # q far from the obstacles
    far_terminal: Quadratic  # phi far from the obstacles


class MeanGrid(NamedTuple):
    """Holds an even grid of means and times."""

    points: np.ndarray  # (n,), means in [-reach, reach]
    times: np.ndarray  # (m + 1,), times in [0, T]

    @property
    def h(self) -> float:
        """Returns the width of a cell."""
        return float(self.points[1] - self.points[0])

    @property
    def dt(self) -> float:
        """Returns the length of a step."""
        return float(self.times[1] - self.times[0])


def mean_grid(equation: ScalarEquation, cells: int, steps: int) -> MeanGrid:
    """Returns a grid of `cells` cells and `steps` steps."""
    reach = equation.reach
    points = np.linspace(-reach, reach, cells + 1)
    return MeanGrid(points, np.linspace(0, equation.duration, steps + 1))


def quadratic(coefficients: Quadratic, mu: np.ndarray) -> np.ndarray:
    """Returns the quadratic at means; coefficients and means are broadcast."""
    constant, slope, curvature = coefficients
    return constant + slope * mu + curvature * mu**2 / 2


def far_field(equation: ScalarEquation, authority: float, times: np.ndarray) -> Quadratic:
    """Returns V of the linear-quadratic problem at times (any shape): coefficients of that shape.

    `authority` is G R^-1 G', which is not always that of `equation`.
    """
    time_to_go = equation.duration - np.asarray(times)
    coefficients = far_solution(equation, authority)(time_to_go.ravel())
    return Quadratic(*coefficients.reshape(3, *time_to_go.shape))


def far_solution(equation: ScalarEquation, authority: float) -> OdeSolution:
    """Returns the coefficients (3, ...) of the linear-quadratic V over the time to go."""
    a = equation.drift
    D = equation.diffusion
    q = equation.far_running

    def rate(_: float, coefficients: np.ndarray) -> list[float]:
        _, slope, curvature = coefficients
        return [
            q.constant + D * curvature / 2 - authority * slope**2 / 2,
            q.slope + a * slope - authority * curvature * slope,
            q.curvature + 2 * a * curvature - authority * curvature**2,
        ]

    return solve_ivp(
        rate,
        (0, equation.duration),
        equation.far_terminal,
        method="DOP853",
        dense_output=True,
        rtol=1e-12,
        atol=1e-13,
    ).sol


def end_values(equation: ScalarEquation, authority: float, grid: MeanGrid) -> np.ndarray:
    """Returns V (m + 1, 2) of the linear-quadratic problem at the two ends of the grid."""
    far = far_field(equation, authority, grid.times)
    return np.stack([quadratic(far, end) for end in grid.points[[0, -1]]], axis=-1)


def first_difference(values: np.ndarray, h: float) -> np.ndarray:
    """Returns centred differences (..., n - 2) of values (..., n)."""
    return (values[..., 2:] - values[..., :-2]) / (2 * h)


def second_difference(values: np.ndarray, h: float) -> np.ndarray:
    """Returns centred second differences (..., n - 2) of values (..., n)."""
    return (values[..., 2:] - 2 * values[..., 1:-1] + values[..., :-2]) / h**2
