"""Two grid solvers: of the linear equation (16) and of the Bellman equation (13).

`solve_desirability` steps (16) by Crank and Nicolson with differences of second order in the cells
and the steps. `solve_value` integrates (13) by the method of lines: differences of fourth order,
LSODA in time. Both share the grid, the costs, and the values beyond the ends of the grid, which are
V of the linear-quadratic problem without obstacles.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import solve_banded

from .scalar_equations import (
    MeanGrid,
    Quadratic,
    ScalarEquation,
    end_values,
    far_solution,
    quadratic,
)

TriBands = tuple[np.ndarray, np.ndarray, np.ndarray]  # below, on and above the diagonal, (n,) each
LSODA_TOLERANCE = 1e-9  # of LSODA, absolute and relative


def solve_desirability(equation: ScalarEquation, grid: MeanGrid) -> np.ndarray:
    """Returns Psi (m + 1, n) of (16), which does not depend on the control's authority."""
    # Where D = lambda G R^-1 G', (16) is a Bellman equation: its far field has this authority.
    matched_authority = equation.diffusion / equation.temperature
    ends = np.exp(-end_values(equation, matched_authority, grid) / equation.temperature)

    lower, centre, upper = _mean_generator(equation, grid)
    centre[1:-1] -= equation.running(grid.points)[1:-1] / equation.temperature
    bands = (lower, centre, upper)

    # Backward in time.
    psi = np.empty((len(grid.times), len(grid.points)))
    psi[-1] = np.exp(-equation.terminal(grid.points) / equation.temperature)
    for k in range(len(psi) - 2, -1, -1):
        explicit = psi[k + 1] + grid.dt / 2 * _banded_product(bands, psi[k + 1])
        psi[k] = _implicit_half_step(bands, explicit, ends[k], grid.dt)
    return psi


def solve_value(equation: ScalarEquation, grid: MeanGrid) -> tuple[np.ndarray, float]:
    """Returns V (m + 1, n) of (13) and a bound on the integrator's error.

    The minimising u makes G u = -G R^-1 G' V_mu. Each step of the integrator errs by no more than
    its tolerance, and the equation magnifies no error. Raises RuntimeError if LSODA gives up.
    """
    mu = grid.points
    h = grid.h
    q = equation.running(mu)[1:-1]
    drift = equation.drift * mu[1:-1]
    far = far_solution(equation, equation.authority)
    outer_points = np.array([mu[0] - h, mu[0], mu[-1], mu[-1] + h])

    def rate(time_to_go: float, inner_values: np.ndarray) -> np.ndarray:
        ends = quadratic(Quadratic(*far(time_to_go)), outer_points)
        V = np.concatenate([ends[:2], inner_values, ends[2:]])
        gradient = (8 * (V[3:-1] - V[1:-3]) - (V[4:] - V[:-4])) / (12 * h)
        hessian = (16 * (V[3:-1] + V[1:-3]) - 30 * V[2:-2] - (V[4:] + V[:-4])) / (12 * h**2)
        Gu = -equation.authority * gradient
        return (
            q
            + Gu**2 / (2 * equation.authority)
            + (drift + Gu) * gradient
            + equation.diffusion / 2 * hessian
        )

    solution = solve_ivp(
        rate,
        (0, equation.duration),
        equation.terminal(mu)[1:-1],
        "LSODA",
        equation.duration - grid.times[::-1],
        rtol=LSODA_TOLERANCE,
        atol=LSODA_TOLERANCE,
        lband=2,
        uband=2,
    )
    if not solution.success:
        raise RuntimeError(solution.message)
    ends = end_values(equation, equation.authority, grid)
    V = np.column_stack([ends[:, 0], solution.y.T[::-1], ends[:, 1]])
    return V, float(solution.nfev * LSODA_TOLERANCE * (1 + np.max(np.abs(V))))


def _mean_generator(equation: ScalarEquation, grid: MeanGrid) -> TriBands:
    """Returns f d/dmu + 1/2 D d^2/dmu^2, with zeros at the ends."""
    drift = equation.drift * grid.points
    diffusion = np.full(len(drift), equation.diffusion / (2 * grid.h**2))
    advection = drift / (2 * grid.h)
    bands = (diffusion - advection, -2 * diffusion, diffusion + advection)
    for band in bands:
        band[[0, -1]] = 0.0
    return bands


def _banded_product(bands: TriBands, v: np.ndarray) -> np.ndarray:
    lower, centre, upper = bands
    product = centre * v
    product[1:-1] += lower[1:-1] * v[:-2] + upper[1:-1] * v[2:]
    return product


def _implicit_half_step(
    bands: TriBands, known: np.ndarray, ends: np.ndarray, dt: float
) -> np.ndarray:
    """Returns v (n,) with v - dt/2 bands v = known inside and the values (2,) at the ends."""
    lower, centre, upper = bands
    matrix = np.zeros((3, len(known)))
    matrix[0, 1:] = -dt / 2 * upper[:-1]
    matrix[1] = 1 - dt / 2 * centre
    matrix[2, :-1] = -dt / 2 * lower[1:]
    right_side = np.concatenate([ends[:1], known[1:-1], ends[1:]])
    return solve_banded(
        (1, 1), matrix, right_side, overwrite_ab=True, overwrite_b=True, check_finite=False
    )
