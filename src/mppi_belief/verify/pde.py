"""The belief mean's equations in one dimension, on grids: for `mppi_belief.verify` to compare the package with.

    -dV/dt   = min_u q + 1/2 R u^2 + (f + G u) V_mu + 1/2 D V_mumu                   (13)
    -dPsi/dt = -q / lambda Psi + f Psi_mu + 1/2 D Psi_mumu,   Psi(T) = exp(-phi / lambda)      (16)

with f = a mu and all else constant in time. `desirability` steps (16) by Crank and Nicolson with differences of
second order in the cells and the steps. `value` integrates (13) by the method of lines: differences of fourth order,
LSODA in time. Both take the grid, the costs, and beyond its ends V of the linear-quadratic problem without the bumps.
`Discrete` is what (18) makes of (17) and (19): exact expectations for a finite step, by Gauss-Hermite nodes
and splines.
"""

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.polynomial.hermite_e import hermegauss
from scipy.integrate import OdeSolution, solve_ivp
from scipy.interpolate import BSpline, make_interp_spline
from scipy.linalg import solve_banded
from scipy.special import logsumexp

Function = Callable[[np.ndarray], np.ndarray]
Bands = tuple[np.ndarray, np.ndarray, np.ndarray]
TOLERANCE = 1e-9  # of LSODA, absolute and relative
NODES = 24  # Gauss-Hermite
CELL, DEGREE = 0.04, 5  # of the splines


class Quadratic(NamedTuple):
    """constant + slope mu + curvature mu^2 / 2."""

    constant: float
    slope: float
    curvature: float


class Equation(NamedTuple):
    """The terms of (13) and (16); `running` and `terminal` map means (n,) to costs (n,) and tend to the quadratics
    far out, where `reach` is."""

    drift: float  # a
    diffusion: float  # D
    authority: float  # G R^-1 G'
    temperature: float  # lambda
    duration: float  # T
    reach: float
    running: Function  # q
    terminal: Function  # phi
    far_running: Quadratic
    far_terminal: Quadratic


class Grid(NamedTuple):
    """Means (n,) in [-reach, reach] and times (m + 1,) in [0, T]."""

    points: np.ndarray
    times: np.ndarray

    @property
    def h(self) -> float:
        """Width of a cell."""
        return float(self.points[1] - self.points[0])

    @property
    def dt(self) -> float:
        """Length of a step."""
        return float(self.times[1] - self.times[0])


def grid(equation: Equation, cells: int, steps: int) -> Grid:
    """An even grid."""
    reach = equation.reach
    return Grid(np.linspace(-reach, reach, cells + 1), np.linspace(0, equation.duration, steps + 1))


def far_field(equation: Equation, authority: float, times: np.ndarray) -> Quadratic:
    """V of the linear-quadratic problem at times (any shape), by the scalar Riccati equation: coefficients of
    that shape."""
    left = equation.duration - np.asarray(times)  # time to go
    found = _far_solution(equation, authority)(left.ravel())
    return Quadratic(*found.reshape(3, *left.shape))


def _far_solution(equation: Equation, authority: float) -> OdeSolution:
    """Its coefficients (3, ...) at times to go."""
    a, D, q = equation.drift, equation.diffusion, equation.far_running

    def rate(_: float, v: np.ndarray) -> list[float]:
        _, s, p = v
        return [
            q.constant + D * p / 2 - authority * s**2 / 2,
            q.slope + a * s - authority * p * s,
            q.curvature + 2 * a * p - authority * p**2,
        ]

    span, settings = (0, equation.duration), {"rtol": 1e-12, "atol": 1e-13}
    return solve_ivp(rate, span, equation.far_terminal, "DOP853", dense_output=True, **settings).sol


def quadratic(coefficients: Quadratic, mu: np.ndarray) -> np.ndarray:
    """The quadratic at means, with the shape that its coefficients and the means broadcast to."""
    constant, slope, curvature = coefficients
    return constant + slope * mu + curvature * mu**2 / 2


def desirability(equation: Equation, on: Grid) -> np.ndarray:
    """Psi (m + 1, n) of (16), whatever the control's authority is."""
    effective = (
        equation.diffusion / equation.temperature
    )  # that for which (16) is a Bellman equation
    ends = np.exp(-_ends(equation, effective, on) / equation.temperature)
    lower, centre, upper = _generator(equation, on, equation.drift * on.points)
    centre[1:-1] -= equation.running(on.points)[1:-1] / equation.temperature
    bands = lower, centre, upper
    psi = np.empty((len(on.times), len(on.points)))
    psi[-1] = np.exp(-equation.terminal(on.points) / equation.temperature)
    for k in range(len(psi) - 2, -1, -1):
        psi[k] = _implicit(
            bands, psi[k + 1] + on.dt / 2 * _apply(bands, psi[k + 1]), ends[k], on.dt
        )
    return psi


def value(equation: Equation, on: Grid) -> tuple[np.ndarray, float]:
    """V (m + 1, n) of (13), whose least u makes G u = -G R^-1 G' V_mu, and a bound on the integrator's error: each of
    its steps errs by no more than its tolerance, and the equation magnifies no error.

    Raises RuntimeError if LSODA gives up.
    """
    mu, h = on.points, on.h
    q, drift, far = (
        equation.running(mu)[1:-1],
        equation.drift * mu[1:-1],
        _far_solution(equation, equation.authority),
    )
    beyond = np.array([mu[0] - h, mu[0], mu[-1], mu[-1] + h])

    def rate(left: float, inside: np.ndarray) -> np.ndarray:
        ends = quadratic(Quadratic(*far(left)), beyond)
        V = np.concatenate([ends[:2], inside, ends[2:]])
        gradient = (8 * (V[3:-1] - V[1:-3]) - (V[4:] - V[:-4])) / (12 * h)
        bend = (16 * (V[3:-1] + V[1:-3]) - 30 * V[2:-2] - (V[4:] + V[:-4])) / (12 * h**2)
        move = -equation.authority * gradient
        return (
            q
            + move**2 / (2 * equation.authority)
            + (drift + move) * gradient
            + equation.diffusion / 2 * bend
        )

    left = equation.duration - on.times[::-1]
    settings = {"rtol": TOLERANCE, "atol": TOLERANCE, "lband": 2, "uband": 2}
    found = solve_ivp(
        rate, (0, equation.duration), equation.terminal(mu)[1:-1], "LSODA", left, **settings
    )
    if not found.success:
        raise RuntimeError(found.message)
    ends = _ends(equation, equation.authority, on)
    V = np.column_stack([ends[:, 0], found.y.T[::-1], ends[:, 1]])
    return V, float(found.nfev * TOLERANCE * (1 + np.max(np.abs(V))))


def slope(values: np.ndarray, h: float) -> np.ndarray:
    """Centred differences (..., n - 2) at the inner points of values (..., n)."""
    return (values[..., 2:] - values[..., :-2]) / (2 * h)


def curvature(values: np.ndarray, h: float) -> np.ndarray:
    """Centred second differences (..., n - 2) of values (..., n)."""
    return (values[..., 2:] - 2 * values[..., 1:-1] + values[..., :-2]) / h**2


def _ends(equation: Equation, authority: float, on: Grid) -> np.ndarray:
    """V (m + 1, 2) at the two ends."""
    far = far_field(equation, authority, on.times)
    return np.stack([quadratic(far, end) for end in on.points[[0, -1]]], axis=-1)


def _generator(equation: Equation, on: Grid, drift: np.ndarray) -> Bands:
    """drift d/dmu + 1/2 D d^2/dmu^2 as three bands (n,), nothing at the ends."""
    spread, carried = np.full(len(drift), equation.diffusion / (2 * on.h**2)), drift / (2 * on.h)
    bands = spread - carried, -2 * spread, spread + carried
    for band in bands:
        band[[0, -1]] = 0.0
    return bands


def _apply(bands: Bands, v: np.ndarray) -> np.ndarray:
    lower, centre, upper = bands
    out = centre * v
    out[1:-1] += lower[1:-1] * v[:-2] + upper[1:-1] * v[2:]
    return out


def _implicit(bands: Bands, known: np.ndarray, ends: np.ndarray, dt: float) -> np.ndarray:
    """v with v - dt/2 bands v = known (n,) inside and the given values (2,) at the ends."""
    lower, centre, upper = bands
    matrix = np.zeros((3, len(known)))
    matrix[0, 1:], matrix[1], matrix[2, :-1] = (
        -dt / 2 * upper[:-1],
        1 - dt / 2 * centre,
        -dt / 2 * lower[1:],
    )
    known = np.concatenate([ends[:1], known[1:-1], ends[1:]])
    return solve_banded(
        (1, 1), matrix, known, overwrite_ab=True, overwrite_b=True, check_finite=False
    )


class Discrete:
    """The expectations of (17) and (19) over (18), exact, with `steps` steps of dt = duration / steps and the cost
    charged at their starts: Psi_k(mu) = exp(-q dt / lambda) E[Psi_{k+1}(mu + a mu dt + L eps)]."""

    def __init__(self, equation: Equation, steps: int, duration: float):
        self.equation, self.steps, self.dt = equation, steps, duration / steps

    def log_psi(self, mu: np.ndarray) -> np.ndarray:
        """log Psi_0 at means (n,)."""
        return self._backward(mu, self._after_first)

    def increment(self, mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weighted mean and variance of L eps_0 / dt at means (n,): (19) but for the control map."""
        logs, pushed = self._ahead(mu, self._after_first)
        weights = np.exp(logs - logsumexp(logs, axis=-1, keepdims=True))
        mean = weights @ pushed / self.dt
        return mean, weights @ (pushed / self.dt) ** 2 - mean**2

    @cached_property
    def _after_first(self) -> BSpline:
        """log Psi_1: nearly quadratic where its argument is large, as splines like it."""
        reach = self.equation.reach
        points = np.linspace(-reach, reach, round(2 * reach / CELL) + 1)
        log = make_interp_spline(
            points, -self.equation.terminal(points) / self.equation.temperature, DEGREE
        )
        charged = self.equation.running(points)
        for _ in range(self.steps - 1):
            log = make_interp_spline(points, self._backward(points, log, charged), DEGREE)
        return log

    def _backward(
        self, mu: np.ndarray, log: BSpline, charged: np.ndarray | None = None
    ) -> np.ndarray:
        q = self.equation.running(mu) if charged is None else charged
        return logsumexp(self._ahead(mu, log)[0], axis=-1) - q * self.dt / self.equation.temperature

    def _ahead(self, mu: np.ndarray, log: BSpline) -> tuple[np.ndarray, np.ndarray]:
        """Log of node weight times Psi (n, nodes), and L eps at the nodes (nodes,)."""
        nodes, weights = hermegauss(NODES)
        pushed = np.sqrt(self.equation.diffusion * self.dt) * nodes
        drifted = np.asarray(mu)[:, None] * (1 + self.equation.drift * self.dt)
        return log(drifted + pushed) + np.log(weights / weights.sum()), pushed
