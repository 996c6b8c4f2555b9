"""Closed loops of Algorithm 1 as printed where the sensor makes matching hold: a platform with four states.

The terminal weight is the stationary P of the discrete control Riccati equation, so that the optimum is u = -K mu at
every step, whatever the horizon. With u_k = -K mu_k + e_k, completing the square gives for any control, in expectation,

    J(u) - J* = sum_k 1/2 e_k' S e_k,      S = R dt + B' P B,  B = G dt

D = lambda G R^-1 G' at every step of every plan, so (19) with N -> infinity is u = -K mu exactly: no excess is left.
N samples leave the variance of a ratio of averages. With weights exp(-S / lambda) squared, which are those of the
control weight R / 2 and the temperature lambda / 2, the increments have the mean -K2 mu and the covariance V2, and

    E e e' = r(mu) (V2 + (K - K2) mu mu' (K - K2)') / N,     r = E w^2 / (E w)^2 = exp(mu' Gamma mu + const)

which is averaged over the law of mu, Gaussian with innovations of covariance D dt.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.linalg import solve_discrete_are

from ..controllers import MPPI
from ..costs import GoalObstacleCost
from ..filters import EKF
from ..planning.path_costs import RiskSensitive
from ..planning.samplers import InnovationSampler
from ..planning.schedules import SharedCovariance
from ..problem import Problem
from ..results.certificate import Check, Line, Panel
from ..simulate import simulate_trial
from ..systems import Steered
from ..trial_metrics import metrics
from .bands import at_least, largest_z, near, quantile, within_errors

TEMPERATURE, DT, STEPS, HORIZON = 1.0, 0.2, 10, 5
STIFFNESS, DRAG, GUSTS, CONTROL_WEIGHT, NOISE = 1.0, 0.5, 0.7, 3.0, 0.3
WEIGHTS, START, SPREAD = (2.0, 2.0, 0.5, 0.5), (0.4, -0.2, 0.0, 0.0), 0.5
SAMPLES, TRIALS = (64, 512), 400
NONE, LIMIT = 1e6, 0.5  # of the sensor, whose signal-to-noise ratio is otherwise up to 3
BATCH = 50  # trials side by side


class Optimum(NamedTuple):
    """Of the discrete problem: F and B of a step, value P, gain K, Hessian S of the cost in one control."""

    F: np.ndarray
    B: np.ndarray
    P: np.ndarray
    K: np.ndarray
    S: np.ndarray


class Expected(NamedTuple):
    """Excess per_sample / N; the next term is `next_term` / N of it."""

    per_sample: float
    next_term: float


def platform() -> tuple[Problem, Optimum]:
    """The platform on moorings in the plane, and its optimum, which knows nothing of the sensor."""
    eye, none = np.eye(2), np.zeros((2, 2))
    A = np.block([[none, eye], [-STIFFNESS * eye, -DRAG * eye]])
    G, R, q = np.vstack([none, eye]), CONTROL_WEIGHT * eye, np.diag(WEIGHTS)
    F, B = np.eye(4) + DT * A, DT * G
    P = solve_discrete_are(F, B, q * DT, R * DT)
    S = R * DT + B.T @ P @ B
    plant: dict[str, Any] = {
        "A": A,
        "B": G,
        "C": np.eye(2, 4),
        "channel": GUSTS * G,
        "sensor_noise": np.full(2, NOISE),
    }
    system = Steered(**plant, temperature=TEMPERATURE, selector="matched")
    cost = GoalObstacleCost(jnp.zeros(4), jnp.array(WEIGHTS), (P + P.T) / 2, jnp.asarray(R))
    problem = Problem(
        system,
        cost,
        jnp.array(START),
        jnp.full(4, SPREAD),
        DT,
        STEPS,
        noise_convention="intensity",
    )
    return problem, Optimum(F, B, P, np.linalg.solve(S, B.T @ P @ F), S)


def covariances(optimum: Optimum) -> tuple[np.ndarray, np.ndarray]:
    """Of the filter with the matched sensor, before each step (K, 4, 4), and D dt (4, 4)."""
    F, B = optimum.F, optimum.B
    moved = TEMPERATURE * B @ B.T / (CONTROL_WEIGHT * DT)
    covs = [SPREAD**2 * np.eye(4)]
    for _ in range(STEPS - 1):
        covs.append(F @ covs[-1] @ F.T + GUSTS**2 * B @ B.T / DT - moved)
    return np.array(covs), moved


def optimal_cost(optimum: Optimum) -> float:
    """Cost of LQG with the matched sensor, by the separation principle."""
    (covs, _), start, noise = (
        covariances(optimum),
        np.array(START),
        GUSTS**2 * optimum.B @ optimum.B.T / DT,
    )
    known = start @ optimum.P @ start + np.sum(optimum.P * (covs[0] + STEPS * noise))
    return 0.5 * float(known + np.sum(optimum.K.T @ optimum.S @ optimum.K * covs.sum(axis=0)))


def recursion(
    optimum: Optimum, R: np.ndarray, tau: float
) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
    """Of E exp(-S / tau) for D = tau G R^-1 G': the value (4, 4) and the constant now, gain and covariance of the first
    increment of the control under these weights."""
    F, B, P, constant = optimum.F, optimum.B, optimum.P, 0.0
    for _ in range(HORIZON):
        S = R * DT + B.T @ P @ B
        K = np.linalg.solve(S, B.T @ P @ F)
        constant += 0.5 * (np.linalg.slogdet(S)[1] - np.linalg.slogdet(R * DT)[1])
        P = np.diag(WEIGHTS) * DT + F.T @ P @ (F - B @ K)
    return P, constant, K, tau * np.linalg.inv(S)


def expected_excess(optimum: Optimum) -> Expected:
    """Of Algorithm 1, as derived above."""
    R = CONTROL_WEIGHT * np.eye(2)
    P, constant, _, _ = recursion(optimum, R, TEMPERATURE)
    P2, constant2, K2, V2 = recursion(optimum, R / 2, TEMPERATURE / 2)
    rate, apart = (P - P2) / TEMPERATURE, optimum.K - K2
    mean, law, moved = np.array(START), np.zeros((4, 4)), covariances(optimum)[1]
    closed, total, largest = optimum.F - optimum.B @ optimum.K, 0.0, 0.0
    for _ in range(STEPS):
        narrowed = np.linalg.inv(np.eye(4) - 2 * law @ rate)
        shifted = narrowed @ mean
        level = math.exp(mean @ rate @ shifted + 2 * constant - constant2) * math.sqrt(
            np.linalg.det(narrowed)
        )
        second = narrowed @ law + np.outer(shifted, shifted)
        total += 0.5 * level * float(np.sum(optimum.S * (V2 + apart @ second @ apart.T)))
        largest = max(largest, level)
        mean, law = closed @ mean, closed @ law @ closed.T + moved
    return Expected(total, largest)


def printed(samples: int) -> MPPI:
    """Algorithm 1 as printed; its schedule is the filter's recursion, which compiles sooner and has the same D."""
    path_cost = RiskSensitive(at_step_end=False)
    schedule = SharedCovariance(method="filter")
    return MPPI(samples, HORIZON, TEMPERATURE, path_cost, InnovationSampler(), schedule)


class Loops(NamedTuple):
    """Closed loops: costs (trials,) and quadratic forms sum_k 1/2 e_k' S e_k (trials,)."""

    cost: np.ndarray
    form: np.ndarray


def closed_loops(
    optimum: Optimum, problem: Problem, samples: int, seed: int, limits: Sequence[float]
) -> list[Loops]:
    """Trials 0..TRIALS-1 for each limit of the sensor; a trial's noise is always the same."""

    def loop(limit: Array, trial: Array) -> tuple[Array, Array]:
        system: Any = problem.system
        at = replace(problem, system=replace(system, limit=limit))
        done = simulate_trial(at, EKF(), printed(samples), seed, trial)
        e = done.controls + done.beliefs.mean[:-1] @ optimum.K.T
        return metrics(at, done).cost, 0.5 * jnp.sum(e @ optimum.S * e)

    def trials(limit: Array) -> tuple[Array, Array]:
        return jax.lax.map(lambda trial: loop(limit, trial), jnp.arange(TRIALS), batch_size=BATCH)

    run = jax.jit(trials, compiler_options={"xla_backend_optimization_level": 1})
    return [Loops(*map(np.asarray, run(jnp.asarray(float(limit))))) for limit in limits]


def certified(seed: int) -> tuple[list[Check], list[Panel]]:
    """The checks and the figure."""
    problem, optimum = platform()
    expected, best = expected_excess(optimum), optimal_cost(optimum)
    few, many = (
        closed_loops(optimum, problem, samples, seed, [NONE, LIMIT]) for samples in SAMPLES
    )
    found = _checks([few[0], many[0]], [few[1].form, many[1].form], expected, best)
    return found, [_panel([few[0].form, many[0].form], [few[1].form, many[1].form], expected, best)]


def error_of(values: np.ndarray) -> float:
    """The standard error of the mean of (n,)."""
    return float(np.std(values, ddof=1)) / math.sqrt(len(values))


def beyond(forms: Sequence[np.ndarray]) -> np.ndarray:
    """The excess of each trial for N -> infinity if it is a + c/N, from the forms at both N."""
    few, many = SAMPLES
    return (many * forms[1] - few * forms[0]) / (many - few)


def _checks(
    runs: Sequence[Loops], limited: Sequence[np.ndarray], expected: Expected, best: float
) -> list[Check]:
    """Of loops with the matched sensor and forms with the limited one, for both N."""
    (few, many), freedom, forms = SAMPLES, TRIALS - 1, [run.form for run in runs]
    predicted = expected.per_sample / np.array(SAMPLES)
    errors, after = (
        np.array([error_of(form) for form in forms]),
        expected.next_term / np.array(SAMPLES),
    )
    means = np.array([form.mean() for form in forms])
    off = np.maximum(np.abs(means - predicted) - predicted * after, 0) / errors
    optimal = [(run.cost - run.form).mean() - best for run in runs]
    drawn = np.array(optimal) / [error_of(run.cost - run.form) for run in runs]
    left, held = beyond(forms), beyond(limited)
    allowed = expected.per_sample * expected.next_term / few / many
    slope, span = math.log(means[1] / means[0]) / math.log(many / few), math.log(many / few)
    spread = quantile(1, freedom) * error_of(forms[1] / means[1] - forms[0] / means[0])
    lowest = held.mean() - quantile(1, freedom) * error_of(held)
    at_both, smaller = (
        f"N = {few} and {many}",
        "1/N; standard errors, and the next term at the smaller N",
    )
    stays = "a sensor that matches would have the next term left"
    return [
        largest_z(f"platform: cost less Σ ½ e'Se less the optimal cost, {at_both}", drawn, freedom),
        largest_z(f"platform: Σ ½ e'Se less c/N, {at_both}, next term allowed for", off, freedom),
        near(
            f"platform: slope of log excess over log N, {at_both}",
            slope,
            -1.0,
            (spread + after[0]) / span,
            smaller,
        ),
        within_errors(
            f"platform: excess for N → ∞, {at_both}",
            left.mean(),
            0.0,
            error_of(left),
            freedom,
            allowed,
        ),
        at_least(
            f"platform, sensor limited to {LIMIT:g}: the same, lower end", lowest, allowed, stays
        ),
    ]


def _panel(
    forms: Sequence[np.ndarray], limited: Sequence[np.ndarray], expected: Expected, best: float
) -> Panel:
    grid = np.geomspace(*SAMPLES, 40)
    lines = [
        Line("c/N, predicted", grid.tolist(), list(100 * expected.per_sample / grid / best)),
        _points("sensor chosen to match", forms, best),
        _points(f"the same, limited to {LIMIT:g}", limited, best),
    ]
    return Panel(
        "Excess cost of Algorithm 1, four states",
        "samples N",
        "excess cost (% of the optimum)",
        lines,
        "xy",
    )


def _points(label: str, forms: Sequence[np.ndarray], best: float) -> Line:
    """Means over trials with intervals, in per cent of the optimum."""
    means, freedom = np.array([form.mean() for form in forms]), TRIALS - 1
    half = quantile(1, freedom) * np.array([error_of(form) for form in forms])
    low, high = (
        list(100 * end / best) for end in (np.maximum(means - half, means / 10), means + half)
    )
    return Line(label, list(SAMPLES), list(100 * means / best), "points", low, high)
