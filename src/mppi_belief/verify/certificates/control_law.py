"""Theorem 6, the control law, against the Bellman equation's control and against LQG.

    u_0 = sum_i w_i u^(i),   u^(i) = R^-1 G' (G R^-1 G')^+ L_0 eps_0^(i) / dt,   w_i ~ exp(-S_i / lambda)      (19)

tends to u = E[exp(-S / lambda) u^(i)] / E[exp(-S / lambda)] as N grows, and that to -R^-1 G' V_mu as dt falls.
For finite N, with primes for half the temperature,

    bias = -(Psi' / Psi^2) (u' - u) / N + O(1 / N^2),   variance = (Psi' / Psi^2) E'[(u^(i) - u)^2] / N + O(1 / N^2).
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...controllers import LQG
from ...planning import path_integral as pi
from ...problem import Belief, Problem
from ...results.certificate import Certificate, Check, Line, Panel
from .. import pde
from ..bands import largest_z, order, quantile, rounding, within_errors
from ..compilation import quick_jit
from ..estimates import RepeatedControls, fitted_rate, limit_check, rms
from ..matched_problem import (
    Matched,
    Steady,
    algorithm_1,
    equation,
    first_controls,
    matched_problem,
    pooled_costs,
    steady,
)
from ..transient import transient_check
from ..underactuated import underactuated_checks

MEANS = np.linspace(-2, 2, 9)
GRIDS = ((560, 40), (1120, 80))  # cells and steps
STEPS = (10, 20, 40, 80)  # of the exact expectation; the first is sampled
KEYS, SAMPLES = 64, 2048
BATCHES = 64
SIZES = 2 ** np.arange(8, 14)  # N of the rate, found at
RATE_MEAN = 1.0
TEXT = (
    "The exact expectation of (19) for a finite Δt, by a backward recursion, tends to the Bellman equation's control "
    "for a dimensionless scalar problem with obstacles, and to the Riccati equation's for a double integrator whose D "
    "has rank one; both sit at the filter's steady state, where (15) holds and D and q are constant in time. "
    "For the light-dark vehicle D, Σ and so q vary along the plan, as no constant R matches: there the package's "
    "Algorithm 1 is the printed one, line by line and to rounding. "
    "Monte Carlo alone sees it only to the percentage named. "
    "At a finite Δt (19) is off by first order, and at a finite N by a bias of order 1/N."
)


class Estimate(NamedTuple):
    """u without sampling, and N times the leading bias and variance of its estimate: each (means,)."""

    control: np.ndarray
    bias: np.ndarray
    variance: np.ndarray


class Rate(NamedTuple):
    """RMS errors (J,) at each N of SIZES, and squared errors over their variance (J,)."""

    rms: np.ndarray
    squared: np.ndarray


def certify(seed: int = 0) -> Certificate:
    """The scalar problem with obstacles, without, an underactuated one, and the algorithm line by line."""
    matched = matched_problem(steps=STEPS[0])
    along = steady(matched.problem, matched.cov)
    terms = equation(matched, along)
    keys = jax.random.split(jax.random.key(seed), 3)
    best, best_error = optimal(matched, terms, MEANS)
    expected = np.stack([exact(matched, terms, H, MEANS) for H in STEPS])
    distances = [rms(u - best) for u in expected]
    sampled, found = sample(matched, terms, keys[0]), at_one(matched, along, terms, keys[1])
    checks = [
        order(
            "exact expectation of (19): RMS distance from -R⁻¹G'V_μ of (16), order in Δt",
            1,
            distances,
        ),
        _limit(expected, best, best_error),
        transient_check(keys[2]),
        *_sampling(sampled, found),
        _linear_quadratic(along),
        *underactuated_checks(),
    ]
    panels = [
        _control_panel(matched, terms, sampled),
        _step_panel([terms.duration / H for H in STEPS], distances),
        _samples_panel(found),
    ]
    return Certificate("control_law", "Theorem 6, control law", TEXT, checks, panels)


def _sampling(sampled: RepeatedControls, found: Rate) -> list[Check]:
    """What Monte Carlo can tell of (19)."""
    seen = quantile(len(MEANS), KEYS - 1) * rms(sampled.error) / rms(sampled.expected)
    relative = 1 / np.sqrt(2 * BATCHES)  # of the RMS of so many Gaussian errors
    tempo, error = fitted_rate(SIZES, found.rms, np.full(len(SIZES), relative))
    return [
        largest_z(
            f"(19) by MPPI-Belief at {len(MEANS)} means (to {seen:.1%} of u): distance from its exact expectation",
            sampled.z,
            KEYS - 1,
        ),
        within_errors("RMS error of (19) over N = 2⁸..2¹³: log-log slope", tempo, -0.5, error),
        within_errors(
            "mean of (error of (19))² over its variance at leading order in 1/N",
            float(np.mean(found.squared)),
            1.0,
            2 * relative / np.sqrt(len(SIZES)),
        ),
    ]


def optimal(
    matched: Matched, terms: pde.Equation, means: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """-R^-1 G' V_mu (means,) at t = 0 from (16), extrapolated from two grids that have the means on them, and how far
    the finer grid's is from that."""
    G, R = np.asarray(matched.problem.system.G(jnp.zeros(1))), np.asarray(matched.problem.cost.R)
    slopes = []
    for cells, steps in GRIDS:
        on = pde.grid(terms, cells, steps)
        at = np.rint((means + terms.reach) / on.h).astype(int)
        around = np.stack([at - 1, at, at + 1], axis=-1)
        V = -terms.temperature * np.log(pde.desirability(terms, on)[0, around])
        slopes.append(pde.slope(V, on.h)[:, 0])
    coarse, fine = slopes
    gain, left = np.linalg.solve(R, G.T)[0, 0], (fine - coarse) / 3
    return -gain * (fine + left), gain * np.abs(left)


def _limit(expected: np.ndarray, best: np.ndarray, best_error: np.ndarray) -> Check:
    """Controls (levels, means) for a step of zero."""
    computed = "the same, extrapolated to Δt = 0: largest distance from -R⁻¹G'V_μ over its error"
    return limit_check(computed, list(expected), best, best_error)


def exact(matched: Matched, terms: pde.Equation, steps: int, means: np.ndarray) -> np.ndarray:
    """(19) with the expectation done exactly (means,)."""
    return _to_control(matched) * pde.Discrete(terms, steps, terms.duration).increment(means)[0]


def estimate(matched: Matched, terms: pde.Equation, means: np.ndarray) -> Estimate:
    """What (19) makes of N samples, to leading order."""
    steps, to_control = matched.problem.steps, _to_control(matched)
    warm = pde.Discrete(terms, steps, terms.duration)
    cold = pde.Discrete(terms._replace(temperature=terms.temperature / 2), steps, terms.duration)
    ratio = np.exp(cold.log_psi(means) - 2 * warm.log_psi(means))
    (mean, _), (colder, variance) = warm.increment(means), cold.increment(means)
    moved = colder - mean
    return Estimate(
        to_control * mean,
        -ratio * to_control * moved,
        ratio * to_control**2 * (variance + moved**2),
    )


def _to_control(matched: Matched) -> float:
    return float(
        pi.control_map(matched.problem.system.G(jnp.zeros(1)), matched.problem.cost.R)[0, 0]
    )


def sample(matched: Matched, terms: pde.Equation, key: Array) -> RepeatedControls:
    """Algorithm 1 as printed at every mean."""
    risk = {"theta": matched.theta, "variance_of": "total"}
    planner = algorithm_1(SAMPLES, matched.problem, matched.temperature, **risk)
    found = quick_jit(first_controls)(
        planner, matched.problem, MEANS[:, None], matched.cov, jax.random.split(key, KEYS)
    )
    truth = estimate(matched, terms, MEANS)
    return RepeatedControls(np.asarray(found)[:, :, 0], truth.control + truth.bias / SAMPLES)


def at_one(matched: Matched, along: Steady, terms: pde.Equation, key: Array) -> Rate:
    """Independent batches of every size at one mean."""
    costs, increments = pooled_costs(matched, along, RATE_MEAN, key, int(BATCHES * SIZES.sum()))
    truth = estimate(matched, terms, np.array([RATE_MEAN]))
    of_batches = quick_jit(
        jax.vmap(lambda S, u: pi.weighted_increments(pi.weights(S, matched.temperature), u))
    )
    cuts = BATCHES * np.cumsum(SIZES)[:-1]
    parts = [
        [part.reshape(BATCHES, -1) for part in np.split(whole, cuts)]
        for whole in (costs, increments)
    ]
    errors = np.array([of_batches(S, u) - truth.control[0] for S, u in zip(*parts, strict=True)])
    square = np.mean(errors**2, axis=1)
    return Rate(np.sqrt(square), square * SIZES / truth.variance[0])


def _linear_quadratic(along: Steady) -> Check:
    """Without obstacles: with Gaussian Psi the exact expectation is the optimum in steps of the same length."""
    matched = matched_problem(w_obs=0.0, theta=0.0)
    terms = equation(matched, along)
    G, R = (
        float(M[0, 0]) for M in (matched.problem.system.G(jnp.zeros(1)), matched.problem.cost.R)
    )
    gap = exact(matched, terms, STEPS[0], MEANS) - lqg(matched.problem, matched.cov)
    # a node's rounding is that of log Psi, of the size it has at the ends of the grid, and moves u by as many nodes
    largest = terms.terminal(np.array([terms.reach]))[0] / terms.temperature
    spread = G / R * np.sqrt(terms.diffusion / matched.problem.dt) / terms.authority
    return rounding(
        "linear-quadratic: exact expectation of (19) less LQG in the same steps, largest",
        float(np.max(np.abs(gap))),
        pde.NODES * STEPS[0],
        largest * spread,
    )


def lqg(problem: Problem, cov: np.ndarray) -> np.ndarray:
    """The package's LQG control (means,) at t = 0."""

    @quick_jit
    def act(problem: Problem, means: Array) -> Array:
        controller = LQG(horizon=0, at_step_end=False)
        plan = controller.init(problem)
        belief = partial(Belief, cov=jnp.asarray(cov))
        return jax.vmap(
            lambda mean: controller.act(problem, belief(mean), plan, jax.random.key(0))[0][0]
        )(means)

    return np.asarray(act(problem, MEANS[:, None]))


def _control_panel(matched: Matched, terms: pde.Equation, sampled: RepeatedControls) -> Panel:
    line = (
        np.arange(-45, 46) * terms.reach / (GRIDS[0][0] / 4)
    )  # every second cell of the coarser grid
    reach = quantile(len(MEANS), KEYS - 1) * sampled.error
    discrete = exact(matched, terms, STEPS[0], line)
    points = Line(
        f"(19) by MPPI-Belief, Δt = {terms.duration / STEPS[0]:g}",
        MEANS.tolist(),
        sampled.mean.tolist(),
        "points",
        (sampled.mean - reach).tolist(),
        (sampled.mean + reach).tolist(),
    )
    lines = [
        Line("-R⁻¹G'V_μ", line.tolist(), optimal(matched, terms, line)[0].tolist()),
        Line("exact expectation of (19)", line.tolist(), discrete.tolist(), "dashed"),
        points,
    ]
    return Panel(
        "Control at t = 0", "belief mean μ (dimensionless)", "control u₀ (dimensionless)", lines
    )


def _step_panel(lengths: list[float], distances: list[float]) -> Panel:
    first = [distances[-1] * dt / lengths[-1] for dt in lengths]
    return Panel(
        "Error in the step",
        "step Δt (dimensionless)",
        "RMS over μ of E(19) + R⁻¹G'V_μ (dimensionless)",
        [Line("found", lengths, distances, "points"), Line("∝ Δt", lengths, first, "dashed")],
        "xy",
    )


def _samples_panel(found: Rate) -> Panel:
    law = found.rms / np.sqrt(found.squared)
    return Panel(
        "Error in the number of samples",
        "number of samples N",
        f"RMS error of (19) at μ = {RATE_MEAN:g} (dimensionless)",
        [
            Line("found", SIZES.tolist(), found.rms.tolist(), "points"),
            Line("its standard error to leading order", SIZES.tolist(), law.tolist(), "dashed"),
        ],
        "xy",
    )
