"""V by the linear equation (16) and by the Bellman equation (13), and what V leaves of (14).

For D = kappa lambda G R^-1 G' the two gradient terms do not cancel: V of (16) leaves in (14)

    dV/dt + q + V_mu' f + 1/2 tr(D V_mumu) - 1/2 V_mu' G R^-1 G' V_mu
        = 1/2 (kappa - 1) V_mu' G R^-1 G' V_mu.
"""

from typing import NamedTuple

import numpy as np

from ..estimates import rms
from . import grid_solutions
from .scalar_equations import (
    MeanGrid,
    ScalarEquation,
    first_difference,
    mean_grid,
    second_difference,
)

REFINEMENTS = ((280, 20), (560, 40), (1120, 80))  # cells and steps of the grids
COMPARED_REACH = 2.5  # |mu| up to which the solutions are compared


class TwoSolutions(NamedTuple):
    """Holds V by both solvers on one grid."""

    grid: MeanGrid
    inner: np.ndarray  # (n,), the means that are compared
    linear: np.ndarray  # (m + 1, n), V of (16)
    direct: np.ndarray  # (m + 1, n), V of (13)
    time_error: float  # bound on the error in time of `direct`


def solve_both(equation: ScalarEquation, cells: int, steps: int) -> TwoSolutions:
    """Returns V by both solvers at the inner means of one grid."""
    grid = mean_grid(equation, cells, steps)
    inside = _compared_points(grid)
    direct, time_error = grid_solutions.solve_value(equation, grid)
    return TwoSolutions(
        grid=grid,
        inner=grid.points[inside],
        linear=_transformed_value(equation, grid, inside),
        direct=direct[:, inside],
        time_error=time_error,
    )


def value_distance(V: np.ndarray, reference: np.ndarray) -> float:
    """Returns the RMS distance of two solutions (m + 1, n) on one grid."""
    return rms(coarsest_points((V - reference)[1:-1, 1:-1]))


def bellman_residual(
    equation: ScalarEquation, grid: MeanGrid, points: np.ndarray, V: np.ndarray
) -> np.ndarray:
    """Returns dV/dt plus the right-hand side of (14) by centred differences.

    V (m + 1, n) is given at points (n,). The result is at the inner means and times of the coarsest
    grid.
    """
    time_derivative = (V[2:, 1:-1] - V[:-2, 1:-1]) / (2 * grid.dt)
    mu = points[1:-1]
    gradient = first_difference(V[1:-1], grid.h)
    hessian = second_difference(V[1:-1], grid.h)
    second_order = equation.diffusion / 2 * hessian - equation.authority / 2 * gradient**2
    return coarsest_points(
        time_derivative + equation.running(mu) + equation.drift * mu * gradient + second_order
    )


def unmatched_residual(
    equation: ScalarEquation, kappa: float, cells: int, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the residual of (14) where D is kappa times the matched one, and its prediction."""
    unmatched = equation._replace(diffusion=kappa * equation.diffusion)
    grid = mean_grid(unmatched, cells, steps)
    inside = _compared_points(grid)
    V = _transformed_value(unmatched, grid, inside)
    gradient = first_difference(V[1:-1], grid.h)
    predicted = (kappa - 1) * unmatched.authority / 2 * gradient**2
    residual = bellman_residual(unmatched, grid, grid.points[inside], V)
    return residual, coarsest_points(predicted)


def coarsest_points(values: np.ndarray) -> np.ndarray:
    """Returns values (m - 1, n - 2) at those inner times and means that the coarsest grid has too.

    On one set of points, errors are a series in h^2.
    """
    every = (len(values) + 1) // REFINEMENTS[0][1]
    return values[every - 1 :: every, every - 1 :: every]


def _compared_points(grid: MeanGrid) -> np.ndarray:
    return np.abs(grid.points) <= COMPARED_REACH + grid.h / 2


def _transformed_value(equation: ScalarEquation, grid: MeanGrid, inside: np.ndarray) -> np.ndarray:
    """Returns -lambda log Psi (m + 1, n) at the points inside."""
    psi = grid_solutions.solve_desirability(equation, grid)
    return -equation.temperature * np.log(psi[:, inside])
