"""Corollary 5, Feynman-Kac: the Monte Carlo desirability against the linear equation's.

    Psi(t, mu) = E_Q[ exp(-1/lambda int_t^T q_s(mu_s) ds - phi_T(mu_T) / lambda) | mu_t = mu ]       (17)

Q is the law of the uncontrolled mean (18). A finite step makes an error of first order in dt; twice the fine
step's sample less the coarse step's, along one Brownian path, leaves one of second order (Richardson).
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...planning import path_integral as pi
from ...problem import Problem
from ...results.certificate import Certificate, Check, Line, Panel
from .. import pde
from ..bands import largest_z, order, quantile, within_errors
from ..compilation import quick_jit
from ..estimates import extrapolations, fitted_rate, limit_check, rms
from ..matched_problem import (
    Matched,
    Steady,
    equation,
    matched_problem,
    pooled_costs,
    sampled_costs,
    steady,
    with_grid,
)

MEANS = np.linspace(-2, 2, 9)
TIMES = np.array([0.0, 0.2, 0.4, 0.6, 0.8])  # of T
GRIDS = ((560, 40), (1120, 80))  # cells and steps
COARSE = 10  # steps from t to T, and twice as many
LEVELS = (10, 20, 40, 80)  # of the exact discrete expectation
BATCHES, PER_BATCH = 64, 512
SIZES = 2 ** np.arange(6, 15)  # N of the rate, found at
RATE_MEAN = 1.0
TEXT = (
    "The package's sampled desirability is compared with the solution of the linear equation (16), at five times "
    "and nine means of the dimensionless matched scalar problem with obstacles. It sits at the filter's steady state: "
    "D and q are constant in time, and a schedule that varies is left to Theorem 6's certificate. "
    "The error in Δt is taken off by extrapolation along the same Brownian paths; what it leaves is found by a "
    "backward recursion without sampling. Without extrapolation a finite Δt biases (17) at first order, whatever N is."
)


class Points(NamedTuple):
    """Psi at TIMES x MEANS, each (times, means): the equation's and its error, the sampled one and its standard
    error, and what the extrapolation leaves of the sampled one's bias."""

    exact: np.ndarray
    exact_error: np.ndarray
    sampled: np.ndarray
    error: np.ndarray
    bias: np.ndarray

    @property
    def z(self) -> np.ndarray:
        """Distances in standard errors, beyond what bias and grid may explain."""
        beyond = np.abs(self.sampled - self.exact) - self.bias - self.exact_error
        return np.maximum(beyond, 0.0) / self.error


class Rate(NamedTuple):
    """At each N of SIZES: RMS error (J,) over the batches and its relative standard error (J,); the mean () of all
    squared errors as multiples of their variance, with its standard error; the pool's mean and its standard error."""

    rms: np.ndarray
    relative: np.ndarray
    squared: float
    squared_error: float
    mean: float
    mean_error: float


def certify(seed: int = 0) -> Certificate:
    """Psi at 45 points, and the rate at which it is found at one of them."""
    matched = matched_problem(steps=COARSE)
    along = steady(with_grid(matched, matched.duration, 2 * COARSE), matched.cov)
    terms = equation(matched, along)
    for_points, for_rate = jax.random.split(jax.random.key(seed))
    points, found = (
        at_points(matched, along, terms, for_points),
        at_one(matched, along, terms, for_rate),
    )
    places = f"{points.z.size} points (t, μ)"
    checks = [
        *_orders(terms, points),
        largest_z(
            f"(17) at {places}: largest distance from (16), extrapolated over Δt",
            points.z,
            BATCHES - 1,
        ),
        *_at_one(terms, found),
    ]
    panels = [_psi_panel(terms, points), _rate_panel(found)]
    return Certificate("feynman_kac", "Corollary 5, Feynman-Kac", TEXT, checks, panels)


def _at_one(terms: pde.Equation, found: Rate) -> list[Check]:
    """Against the exact discrete expectation."""
    tempo, error = fitted_rate(SIZES, found.rms, found.relative)
    discrete = np.exp(pde.Discrete(terms, COARSE, terms.duration).log_psi(np.array([RATE_MEAN])))[0]
    return [
        within_errors(
            f"(17) at one mean from {found_paths()} paths over the exact discrete expectation",
            found.mean / discrete,
            1.0,
            found.mean_error / discrete,
        ),
        within_errors("RMS error of (17) over N = 2⁶..2¹⁴: log-log slope", tempo, -0.5, error),
        within_errors(
            "mean of N (error of (17))² / Var exp(-S/λ), the variance exact",
            found.squared,
            1.0,
            found.squared_error,
        ),
    ]


def found_paths() -> int:
    """How many paths the rate takes."""
    return int(BATCHES * SIZES.sum())


def discrete_psi(terms: pde.Equation, steps: int, times: np.ndarray) -> np.ndarray:
    """Exact discrete expectations (times, means), each over `steps` steps from t to T."""
    left = terms.duration * (1 - times)
    return np.exp([pde.Discrete(terms, steps, duration).log_psi(MEANS) for duration in left])


def solution(terms: pde.Equation) -> tuple[np.ndarray, np.ndarray]:
    """Psi of (16) (times, means) extrapolated from two grids, and how far the finer grid is from that."""
    values = []
    for cells, steps in GRIDS:
        on = pde.grid(terms, cells, steps)
        rows, columns = (
            np.rint(TIMES * steps).astype(int),
            np.rint((MEANS + on.points[-1]) / on.h).astype(int),
        )
        values.append(pde.desirability(terms, on)[np.ix_(rows, columns)])
    coarse, fine = values
    return fine + (fine - coarse) / 3, np.abs(fine - coarse) / 3


def at_points(matched: Matched, along: Steady, terms: pde.Equation, key: Array) -> Points:
    """The comparison at all points; all means of one time share their paths."""
    samples = []
    for t, k in zip(TIMES, jax.random.split(key, len(TIMES)), strict=True):
        left = terms.duration * (1 - t)
        coarse, fine = with_grid(matched, left, COARSE), with_grid(matched, left, 2 * COARSE)
        samples.append(np.exp(_batches(coarse, fine, matched, along, MEANS[:, None], k)))
    logs = np.stack(samples)  # (times, means, level, batches)
    extrapolated = 2 * logs[:, :, 1] - logs[:, :, 0]
    error = extrapolated.std(axis=-1, ddof=1) / np.sqrt(BATCHES)
    levels = [discrete_psi(terms, H, TIMES) for H in LEVELS[:3]]
    first, second, *_ = extrapolations(levels)
    bias = 4 / 3 * np.abs(first - second)
    return Points(*solution(terms), extrapolated.mean(axis=-1), error, bias)


@jax.jit
def _batches(
    coarse: Problem, fine: Problem, matched: Matched, along: Steady, means: Array, key: Array
) -> Array:
    """log Psi (means, 2, batches) for the coarse and the fine step along the same Brownian paths."""
    eps = jnp.sqrt(fine.dt) * pi.normals(key, (2 * COARSE, 1, BATCHES * PER_BATCH), False)
    of_batches = jax.vmap(partial(pi.log_desirability, temperature=matched.temperature))

    def at(mean: Array) -> Array:
        levels = ((coarse, eps[::2] + eps[1::2]), (fine, eps))
        costs = [sampled_costs(problem, matched.theta, mean, along, e)[0] for problem, e in levels]
        return jnp.stack([of_batches(c.reshape(BATCHES, PER_BATCH)) for c in costs])

    return jax.lax.map(at, means)


def at_one(matched: Matched, along: Steady, terms: pde.Equation, key: Array) -> Rate:
    """Independent batches of every size against the exact discrete expectation, whose second moment is that at half
    the temperature."""
    costs, _ = pooled_costs(matched, along, RATE_MEAN, key, found_paths())
    truth, second = (
        float(
            np.exp(
                pde.Discrete(terms._replace(temperature=heat), COARSE, terms.duration).log_psi(at)[
                    0
                ]
            )
        )
        for heat, at in (
            (terms.temperature, np.array([RATE_MEAN])),
            (terms.temperature / 2, np.array([RATE_MEAN])),
        )
    )
    variance = second - truth**2
    weights = np.exp(-costs / matched.temperature)
    excess = float(np.mean((weights - truth) ** 4) / variance**2 - 3)
    estimate = quick_jit(jax.vmap(partial(pi.log_desirability, temperature=matched.temperature)))
    parts = np.split(costs, BATCHES * np.cumsum(SIZES)[:-1])
    errors = np.array([np.exp(estimate(p.reshape(BATCHES, -1))) - truth for p in parts])
    # a mean of n squared errors has relative variance (2 + excess kurtosis) / n, an average of N a kurtosis of 1 / N
    spread = (2 + excess / SIZES) / BATCHES
    squared = np.mean(errors**2, axis=1) * SIZES / variance
    return Rate(
        rms=np.sqrt(np.mean(errors**2, axis=1)),
        relative=np.sqrt(spread) / 2,
        squared=float(np.mean(squared)),
        squared_error=float(np.sqrt(np.mean(spread) / len(SIZES))),
        mean=float(np.mean(weights)),
        mean_error=float(np.sqrt(variance / len(weights))),
    )


def _orders(terms: pde.Equation, points: Points) -> list[Check]:
    """Without sampling: the discrete expectation at t = 0 against (16)."""
    levels = [discrete_psi(terms, H, TIMES[:1])[0] for H in LEVELS]
    errors = [rms(psi - points.exact[0]) for psi in levels]
    said = "the same, extrapolated to Δt = 0: largest distance from (16) over its error"
    return [
        order(
            "exact expectation of (17) over (18): RMS distance from (16), order in Δt", 1, errors
        ),
        limit_check(said, levels, points.exact[0], points.exact_error[0]),
    ]


def _psi_panel(terms: pde.Equation, points: Points) -> Panel:
    on = pde.grid(terms, *GRIDS[0])
    inside = np.abs(on.points) <= 2.5
    psi, sampled = pde.desirability(terms, on)[0, inside], points.sampled[0]
    reach = quantile(points.z.size, BATCHES - 1) * points.error[0]
    low, high = (sampled - reach).tolist(), (sampled + reach).tolist()
    lines = [
        Line("linear equation (16)", on.points[inside].tolist(), psi.tolist()),
        Line("Monte Carlo (17)", MEANS.tolist(), sampled.tolist(), "points", low, high),
    ]
    return Panel(
        "Desirability at t = 0",
        "belief mean μ (dimensionless)",
        "desirability Ψ(0, μ) (dimensionless)",
        lines,
    )


def _rate_panel(found: Rate) -> Panel:
    law = found.mean_error * np.sqrt(BATCHES * SIZES.sum() / SIZES)
    low, high = (
        (found.rms * (1 - 2 * found.relative)).tolist(),
        (found.rms * (1 + 2 * found.relative)).tolist(),
    )
    return Panel(
        "Error of the Monte Carlo desirability",
        "number of samples N",
        f"RMS error of Ψ(0, {RATE_MEAN:g}) (dimensionless)",
        [
            Line("found", SIZES.tolist(), found.rms.tolist(), "points", low, high),
            Line("its exact standard error", SIZES.tolist(), law.tolist(), "dashed"),
        ],
        "xy",
    )
