"""Theorem 4, Cole-Hopf, by finite differences on the matched scalar problem.

    -dV/dt = min_u q + 1/2 u' R u + V_mu' (f + G u) + 1/2 tr(D V_mumu)               (13)
    -dV/dt = q + V_mu' f + 1/2 tr(D V_mumu) - 1/2 V_mu' G R^-1 G' V_mu               (14)
    D      = lambda G R^-1 G'                                                        (15)
    -dPsi/dt = -q / lambda Psi + Psi_mu' f + 1/2 tr(D Psi_mumu),   V = -lambda log Psi          (16)

For D = kappa lambda G R^-1 G' the two gradient terms do not cancel: V of (16) leaves in (14)

    dV/dt + q + V_mu' f + 1/2 tr(D V_mumu) - 1/2 V_mu' G R^-1 G' V_mu = 1/2 (kappa - 1) V_mu' G R^-1 G' V_mu.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ...results.certificate import Certificate, Check, Line, Panel
from .. import pde
from ..bands import at_most, near, order, rounding
from ..estimates import rms
from ..matched_problem import Matched, Steady, equation, matched_problem, matching_check, steady

GRIDS = ((280, 20), (560, 40), (1120, 80))  # cells and steps
INNER = 2.5  # |mu| up to which the solutions are compared
KAPPAS = (0.5, 0.8, 1.25, 2.0)
DRAWN = np.linspace(0.5, 2, 31)  # kappas of the drawn prediction
TEXT = (
    "A dimensionless scalar problem with two obstacles and a risk-sensitive cost, at the filter's steady state, where "
    "(15) holds exactly: the linear equation (16) by Crank and Nicolson, the Bellman equation (13) by the method of "
    "lines with fourth-order differences and an adaptive integrator. They share the costs, the cells and the values "
    "beyond the grid, which are the Riccati equation's; without obstacles both are held against it inside too. "
    "Without (15) the gradient terms do not cancel; what is left is ½(κ-1)V_μ'GR⁻¹G'V_μ with the V of that κ. "
    "The theorem is exact for given D and q; whether they describe the belief is not its subject."
)


class Solved(NamedTuple):
    """One grid: its width, the inner means (n,), V of (16) and of (13), both (m + 1, n), and a bound on the latter's
    error in time."""

    on: pde.Grid
    inner: np.ndarray
    linear: np.ndarray
    direct: np.ndarray
    in_time: float


def certify(seed: int = 0) -> Certificate:
    """Nothing here is random: the seed changes nothing."""
    matched = matched_problem()
    along = steady(matched.problem, matched.cov)
    terms = equation(matched, along)
    solved = [solve(terms, *size) for size in GRIDS]
    residuals = [rms(hjb_residual(terms, s.on, s.inner, s.linear)) for s in solved]
    gaps = [distance(s.linear, s.direct) for s in solved]
    broken = {kappa: [mismatch(terms, kappa, *size) for size in GRIDS] for kappa in KAPPAS}
    checks = [
        _matching(matched, along),
        order("RMS residual of (14) at V = -λ log Ψ: order in the cells and steps", 2, residuals),
        order("RMS distance of V by (16) from V by (13), method of lines: order", 2, gaps),
        *_minimised(matched, terms, solved[-1]),
        *_linear_quadratic(along),
        *_broken(broken),
    ]
    return Certificate(
        "cole_hopf",
        "Theorem 4, Cole-Hopf",
        TEXT,
        checks,
        _panels(terms, solved, residuals, broken),
    )


def solve(terms: pde.Equation, cells: int, steps: int) -> Solved:
    """V by both schemes on one grid, at the inner means."""
    on = pde.grid(terms, cells, steps)
    inside = np.abs(on.points) <= INNER + on.h / 2
    linear = -terms.temperature * np.log(pde.desirability(terms, on)[:, inside])
    direct, in_time = pde.value(terms, on)
    return Solved(on, on.points[inside], linear, direct[:, inside], in_time)


def distance(V: np.ndarray, other: np.ndarray) -> float:
    """RMS distance of two solutions (m + 1, n) of one grid."""
    return rms(_shared((V - other)[1:-1, 1:-1]))


def hjb_residual(
    terms: pde.Equation, on: pde.Grid, points: np.ndarray, V: np.ndarray
) -> np.ndarray:
    """dV/dt plus the right-hand side of (14) by centred differences, for V (m + 1, n) at points (n,): at the points and
    times within the coarsest grid's."""
    in_time, now, mu = (V[2:, 1:-1] - V[:-2, 1:-1]) / (2 * on.dt), V[1:-1], points[1:-1]
    gradient = pde.slope(now, on.h)
    bent = terms.diffusion / 2 * pde.curvature(now, on.h) - terms.authority / 2 * gradient**2
    return _shared(in_time + terms.running(mu) + terms.drift * mu * gradient + bent)


def mismatch(
    terms: pde.Equation, kappa: float, cells: int, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """The residual of (14) where D is kappa times the matched one, and what is predicted for it."""
    terms = terms._replace(diffusion=kappa * terms.diffusion)
    on = pde.grid(terms, cells, steps)
    inside = np.abs(on.points) <= INNER + on.h / 2
    V = -terms.temperature * np.log(pde.desirability(terms, on)[:, inside])
    predicted = (kappa - 1) * terms.authority / 2 * pde.slope(V[1:-1], on.h) ** 2
    return hjb_residual(terms, on, on.points[inside], V), _shared(predicted)


def _shared(found: np.ndarray) -> np.ndarray:
    """The inner times and means of a grid (m - 1, n - 2) that are the coarsest grid's too: on one set of points
    errors are a series in h^2."""
    every = (len(found) + 1) // GRIDS[0][1]
    return found[every - 1 :: every, every - 1 :: every]


def _matching(matched: Matched, along: Steady) -> Check:
    said = "largest residual ε of (15) along the gain schedule"
    return matching_check(said, matched.problem, matched.temperature, along)


def _minimised(matched: Matched, terms: pde.Equation, solved: Solved) -> list[Check]:
    """(13) minimised over a grid of controls; the parabola through the least three values is exact."""
    problem = matched.problem
    G, R = float(problem.system.G(jnp.zeros(1))[0, 0]), float(problem.cost.R[0, 0])
    gradient, controls = pde.slope(solved.linear[0], solved.on.h), np.linspace(-8, 8, 33)
    width = controls[1] - controls[0]
    terms_of_u = R / 2 * controls**2 + gradient[:, None] * G * controls
    least = np.argmin(terms_of_u, axis=1)
    left, centre, right = (terms_of_u[np.arange(len(least)), least + j] for j in (-1, 0, 1))
    change, bend = (right - left) / 2, right - 2 * centre + left
    best, value = controls[least] - width * change / bend, centre - change**2 / (2 * bend)
    size = np.max(np.abs([left, centre, right]))
    wrong, wrong_value = best + G / R * gradient, value + terms.authority / 2 * gradient**2
    return [
        rounding(
            "least u in (13) over a grid, parabola between, plus R⁻¹G'V_μ",
            _largest(wrong),
            20,
            size / R / width,
        ),
        rounding(
            "least value of (13) over u less the control term of (14)",
            _largest(wrong_value),
            20,
            size,
        ),
    ]


def _largest(values: np.ndarray) -> float:
    return float(np.max(np.abs(values)))


def _linear_quadratic(along: Steady) -> list[Check]:
    """Without obstacles V is the quadratic of the scalar Riccati equation."""
    terms = equation(matched_problem(w_obs=0.0, theta=0.0), along)
    solved = [solve(terms, *size) for size in GRIDS]
    exact = [
        pde.quadratic(pde.far_field(terms, terms.authority, s.on.times[:, None]), s.inner)
        for s in solved
    ]
    linear = [distance(s.linear, V) for s, V in zip(solved, exact, strict=True)]
    direct = [distance(s.direct, V) for s, V in zip(solved, exact, strict=True)]
    return [
        order(
            "linear-quadratic: RMS distance of V by (16) from the Riccati solution, order",
            2,
            linear,
        ),
        at_most(
            "linear-quadratic: RMS distance of V by (13) from the Riccati solution over its bound",
            max(found / s.in_time for found, s in zip(direct, solved, strict=True)),
            1.0,
            "LSODA's tolerance times its steps; the differences are exact for quadratics",
        ),
    ]


def _broken(broken: dict[float, list[tuple[np.ndarray, np.ndarray]]]) -> list[Check]:
    """What is left is what is predicted, for every kappa."""
    slopes = {
        kappa: [
            float(np.sum(found * predicted) / np.sum(predicted**2)) for found, predicted in grids
        ]
        for kappa, grids in broken.items()
    }
    changes = {kappa: abs(s[-1] - s[-2]) for kappa, s in slopes.items()}
    worst = max(slopes, key=lambda kappa: abs(slopes[kappa][-1] - 1) / changes[kappa])
    left = [
        float(np.sqrt(np.mean([rms(found - predicted) ** 2 for found, predicted in grids])))
        for grids in zip(*broken.values(), strict=True)
    ]
    derived = "its change from the coarser grid, three times what is left at order 2"
    return [
        near(
            f"residual of (14) for D = κλGR⁻¹G' over ½(κ-1)V_μ'GR⁻¹G'V_μ, worst κ = {worst:g}: slope",
            slopes[worst][-1],
            1.0,
            changes[worst],
            derived,
        ),
        order("RMS of that residual less its prediction, all κ together: order", 2, left),
    ]


def _panels(
    terms: pde.Equation,
    solved: list[Solved],
    residuals: list[float],
    broken: dict[float, list[tuple[np.ndarray, np.ndarray]]],
) -> list[Panel]:
    s = solved[0]
    mu, widths = s.inner.tolist(), [s.on.h for s in solved]
    law = [residuals[-1] * (h / widths[-1]) ** 2 for h in widths]
    sizes = {1.0: residuals[-1]} | {kappa: rms(grids[-1][0]) for kappa, grids in broken.items()}
    kappas = sorted(sizes)
    predicted = [rms(mismatch(terms, kappa, *GRIDS[0])[1]) for kappa in DRAWN]
    values = [
        Line("V by (16), Cole-Hopf", mu, s.linear[0].tolist()),
        Line("V by (13), method of lines", mu[::5], s.direct[0, ::5].tolist(), "points"),
        Line("reduced cost q", mu, terms.running(s.inner).tolist(), "dashed"),
    ]
    return [
        Panel(
            "Cost-to-go at t = 0",
            "belief mean μ (dimensionless)",
            "V(0, μ), q(μ) (dimensionless)",
            values,
        ),
        Panel(
            "Residual of the Bellman equation",
            "cell width h (dimensionless)",
            "RMS residual of (14) (dimensionless)",
            [Line("found", widths, residuals, "points"), Line("order 2", widths, law, "dashed")],
            "xy",
        ),
        Panel(
            "Matching broken: D = κ λ G R⁻¹ G'",
            "factor κ, 1 where matching holds",
            "RMS residual of (14) (dimensionless)",
            [
                Line("found", kappas, [sizes[kappa] for kappa in kappas], "points"),
                Line("½ |κ - 1| V_μ' G R⁻¹ G' V_μ", DRAWN.tolist(), predicted, "dashed"),
            ],
        ),
    ]
