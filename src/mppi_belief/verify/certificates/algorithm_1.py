"""Algorithm 1 end to end: closed loops of the algorithm as printed against the optimal control (LQG).

Scalar system (Remark 2), D = lambda b^2 / R (15) at the steady state of (8b), terminal weight the stationary P of the
discrete control Riccati equation: the optimal gain K is then the same at every step, whatever the horizon. With
u_k = -K mu_k + e_k, completing the square gives for any control, in expectation,

    J(u) - J* = sum_k 1/2 S e_k^2,      S = R dt + B P B,  B = b dt

What (19) makes of e_k follows from Gaussian integrals. With P_j the curvature of -lambda log Psi (17) in discrete time,

    P_j = q dt + F^2 P_{j+1} / (1 + P_{j+1} D_j dt / lambda)

which is the control Riccati equation where D_j = lambda b^2 / R. So N -> infinity leaves no error but that of D_j: the
sampled filter settles a little off the steady state of (8b). N samples add the variance of a ratio of averages, 1/N.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.linalg import solve_discrete_are

from ...belief.prior import prior
from ...belief.schedule import gain_schedule
from ...controllers import LQG, MPPI
from ...costs import GoalObstacleCost
from ...filters import EKF
from ...planning.path_costs import RiskSensitive
from ...planning.samplers import InnovationSampler
from ...planning.schedules import SharedCovariance
from ...problem import Belief, Controller, Problem
from ...results.certificate import Certificate, Check, Line, Panel
from ...simulate import simulate_trial
from ...systems import ScalarLinear
from ...trial_metrics import metrics
from ..bands import at_most, largest_z, near, quantile, rounding, within_errors

DRIFT, CONTROL_GAIN, STATE_WEIGHT, TEMPERATURE = 0.0, 1.0, 2.0, 1.0  # a, b, q, lambda
NOISE = 0.5  # sigma_w and sigma_o
DT, STEPS, HORIZON = 0.2, 10, 5
SAMPLES = (16, 64, 256, 1024)
TRIALS, OPTIMAL_TRIALS = 400, 4000
BATCH = 50  # trials side by side


class Optimum(NamedTuple):
    """Of the discrete problem: value P, gain K, Hessian S of the cost in one control."""

    value: float
    gain: float
    hessian: float


class Tilt(NamedTuple):
    """E exp(-S / tau) = exp(-value mu^2 / (2 tau) - constant); under these weights the first step of the mean is drawn
    from N(-pull mu, spread). All (K,), one for each step of the trial."""

    value: np.ndarray
    constant: np.ndarray
    pull: np.ndarray
    spread: np.ndarray


class Expected(NamedTuple):
    """Excess floor + per_sample / N; the next term is `next_term` / N of the one before."""

    floor: float
    per_sample: float
    next_term: float

    def excess(self, samples: Any) -> Any:
        """Over the optimum, for N = `samples`."""
        return self.floor + self.per_sample / samples


class Loops(NamedTuple):
    """Closed loops: costs (trials,), means mu_k and controls (trials, steps)."""

    cost: np.ndarray
    mean: np.ndarray
    control: np.ndarray


def stationary_problem() -> tuple[Problem, Optimum]:
    """The system at the steady state of (8b) for a = 0, R = lambda b^2 / D, and the optimum of its discrete problem."""
    steady = NOISE * NOISE  # 0 = sigma_w^2 - Sigma^2 / sigma_o^2
    R = TEMPERATURE * CONTROL_GAIN**2 / (steady / NOISE) ** 2
    F, B = 1 + DRIFT * DT, CONTROL_GAIN * DT
    P = float(solve_discrete_are([[F]], [[B]], [[STATE_WEIGHT * DT]], [[R * DT]])[0, 0])
    hessian = R * DT + B * P * B
    system = ScalarLinear(DRIFT, CONTROL_GAIN, 1.0, NOISE, NOISE)
    one = jnp.ones(1)
    cost = GoalObstacleCost(0 * one, STATE_WEIGHT * one, P * one, R * one)
    std = math.sqrt(steady) * one
    problem = Problem(system, cost, one, std, DT, STEPS, noise_convention="intensity")
    return problem, Optimum(P, F * P * B / hessian, hessian)


def optimal_cost(problem: Problem, optimum: Optimum, covs: np.ndarray) -> float:
    """Cost of LQG by the separation principle: the start, the process noise, the feedback on what is not known."""
    start = float(problem.prior_mean[0] ** 2 + problem.prior_std[0] ** 2)
    noise = optimum.value * NOISE**2 * DT
    return 0.5 * (
        optimum.value * start
        + STEPS * noise
        + optimum.gain**2 * optimum.hessian * float(np.sum(covs))
    )


def filtered_law(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Of the Kalman filter: covariances before each step and variances of the mean's steps, both (K,)."""
    schedule = gain_schedule(problem, prior(problem), jnp.zeros((STEPS, 1)), "filter")
    return np.asarray(schedule.cov)[:-1, 0, 0], np.asarray(schedule.diffusion)[:, 0, 0] * DT


def planned_diffusions(problem: Problem, covs: np.ndarray) -> np.ndarray:
    """D_j (K, H) of the plans that start from the filter's covariances (K,): line 1 of Algorithm 1."""

    def diffusions(cov: Array) -> Array:
        belief = Belief(jnp.zeros(1), cov.reshape(1, 1))
        return gain_schedule(problem, belief, jnp.zeros((HORIZON, 1)), "riccati").diffusion[:, 0, 0]

    return np.asarray(jax.jit(jax.vmap(diffusions))(jnp.asarray(covs)))


def tilted(diffusions: np.ndarray, terminal: float, tau: float) -> Tilt:
    """The Gaussian integral over the paths of the mean, backwards, for D_j (K, H) and a terminal weight."""
    F = 1 + DRIFT * DT
    value, constant = np.full(len(diffusions), terminal), np.zeros(len(diffusions))
    pull = spread = constant
    for D in diffusions.T[::-1]:
        gain = value * D * DT / tau
        pull, spread = F * gain / (1 + gain), D * DT / (1 + gain)
        constant = constant + 0.5 * np.log1p(gain)
        value = STATE_WEIGHT * DT + F**2 * value / (1 + gain)
    return Tilt(value, constant, pull, spread)


def expected_excess(
    problem: Problem, optimum: Optimum, covs: np.ndarray, innovations: np.ndarray
) -> Expected:
    """Of Algorithm 1, from the filter's covariances and the variances of the mean's steps, both (K,).

    A ratio of averages sum w x / sum w has variance E[w^2 (x - x*)^2] / (N E[w]^2) and bias
    -E[w^2 (x - x*)] / (N E[w]^2); the square of a weight is the weight at half the temperature.
    """
    diffusions, B = planned_diffusions(problem, covs), CONTROL_GAIN * DT
    once, twice = (tilted(diffusions, optimum.value, tau) for tau in (TEMPERATURE, TEMPERATURE / 2))
    mean, variance = mean_law(float(problem.prior_mean[0]), once.pull, innovations)
    # E[w^2] / E[w]^2 = exp(rate mu^2 + ...): another Gaussian integral, over the law of mu_k
    rate = (once.value - twice.value) / TEMPERATURE
    narrowed = 1 - 2 * rate * variance
    ratio = np.exp(rate * mean**2 / narrowed + 2 * once.constant - twice.constant) / np.sqrt(
        narrowed
    )
    square = ratio * ((mean / narrowed) ** 2 + variance / narrowed)
    apart, wrong = once.pull - twice.pull, optimum.gain - once.pull / B
    sampling = (apart**2 * square + twice.spread * ratio) / B**2 - 2 * wrong * apart * square / B
    floor = 0.5 * optimum.hessian * np.sum(wrong**2 * (mean**2 + variance))
    return Expected(
        float(floor), float(0.5 * optimum.hessian * np.sum(sampling)), float(np.max(ratio))
    )


def mean_law(
    start: float, pulls: np.ndarray, innovations: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Means and variances (K,) of mu_k under mu' = (F - pull) mu + innovation."""
    law = [(start, 0.0)]
    for pull, innovation in zip(pulls[:-1], innovations[:-1], strict=True):
        keep = 1 + DRIFT * DT - pull
        law.append((keep * law[-1][0], keep**2 * law[-1][1] + innovation))
    mean, variance = np.array(law).T
    return mean, variance


def printed(samples: int) -> MPPI:
    """Algorithm 1 as printed."""
    path_cost = RiskSensitive(at_step_end=False)
    schedule = SharedCovariance(method="riccati")
    return MPPI(samples, HORIZON, TEMPERATURE, path_cost, InnovationSampler(), schedule)


def closed_loops(problem: Problem, controller: Controller, seed: int, trials: int) -> Loops:
    """Trials 0..trials-1; a trial's noise is the same for every controller."""

    def loop(trial: Array) -> tuple[Array, Array, Array]:
        done = simulate_trial(problem, EKF(), controller, seed, trial)
        return metrics(problem, done).cost, done.beliefs.mean[:-1, 0], done.controls[:, 0]

    # compiling takes longer than running: the problem is a constant here, which saves a third, and so does this option
    options = {"xla_backend_optimization_level": 1}
    loops = jax.jit(
        lambda numbers: jax.lax.map(loop, numbers, batch_size=BATCH), compiler_options=options
    )
    return Loops(*map(np.asarray, loops(jnp.arange(trials))))


def standard_error(values: np.ndarray) -> float:
    """Of the mean of (n,)."""
    return float(np.std(values, ddof=1)) / math.sqrt(len(values))


def certify(seed: int = 0) -> Certificate:
    """Closed loops of Algorithm 1 for growing N and of LQG, with the same noise, against what both must cost."""
    problem, optimum = stationary_problem()
    covs, innovations = filtered_law(problem)
    best = optimal_cost(problem, optimum, covs)
    expected = expected_excess(problem, optimum, covs, innovations)
    lqg = closed_loops(problem, LQG(horizon=0, at_step_end=False), seed, OPTIMAL_TRIALS)
    runs = [closed_loops(problem, printed(samples), seed, TRIALS) for samples in SAMPLES]
    forms = np.array(
        [
            0.5 * optimum.hessian * np.sum((r.control + optimum.gain * r.mean) ** 2, axis=1)
            for r in runs
        ]
    )
    paired = np.array([r.cost - lqg.cost[:TRIALS] for r in runs])
    checks = [
        *_optimum_checks(problem, optimum, best, lqg),
        *_excess_checks(paired, forms, expected, best),
    ]
    text = (
        "Algorithm 1 as printed was run in closed loop on a scalar system that is matched at the steady state of (8b), "
        "against LQG with the same noise. Its excess cost equals the quadratic form of its control errors and falls as "
        f"1/N, at the rate that Gaussian integrals predict; {100 * expected.floor / best:.2f} % of the optimum is left "
        "for N → ∞, because the filter of a sampled measurement settles O(Δt) off that steady state. With D = λb²/R at "
        "every step, (19) is the discrete LQG control for any Δt: that check is algebra, no sampling code is in it. "
        "One state and a quadratic cost: nothing is said about several states, or where the matching condition fails."
    )
    panels = [_excess_panel(paired, forms, expected, best), _loop_panel(runs, lqg)]
    return Certificate("algorithm_1", "Algorithm 1 end to end", text, checks, panels)


def _optimum_checks(problem: Problem, optimum: Optimum, best: float, lqg: Loops) -> list[Check]:
    """The library's LQG, and (19) with the exact expectation where D is matched, are the optimum."""
    D = TEMPERATURE * CONTROL_GAIN**2 / float(problem.cost.R[0, 0])
    matched = tilted(np.full((1, HORIZON), D), optimum.value, TEMPERATURE).pull[0] / (
        CONTROL_GAIN * DT
    )
    apart, trials = matched - optimum.gain, len(lqg.cost)
    gap, largest = np.max(np.abs(lqg.control + optimum.gain * lqg.mean)), np.max(np.abs(lqg.mean))
    cost = f"cost of LQG, {trials} trials, against the closed form"
    gain = (
        "algebra of (19), nothing sampled: its K at D = λb²/R by NumPy, less SciPy's Riccati gain"
    )
    return [
        rounding(gain, apart, 10 * HORIZON),
        rounding("largest |u + K μ| of LQG, K stationary", float(gap), 20 * STEPS, float(largest)),
        within_errors(cost, float(np.mean(lqg.cost)), best, standard_error(lqg.cost), trials - 1),
    ]


def _excess_checks(
    paired: np.ndarray, forms: np.ndarray, expected: Expected, best: float
) -> list[Check]:
    """Paired excess and quadratic forms (samples, trials) against each other and the prediction."""
    samples, freedom, most = np.array(SAMPLES), forms.shape[1] - 1, SAMPLES[-1]
    martingale = paired - forms
    drawn = martingale.mean(axis=1) / [standard_error(row) for row in martingale]
    means, errors = forms.mean(axis=1), np.array([standard_error(form) for form in forms])
    beyond = expected.per_sample / samples * expected.next_term / samples
    off = np.maximum(np.abs(means - expected.excess(samples)) - beyond, 0) / errors
    upper, half = means[-1] + quantile(1, freedom) * errors[-1], expected.excess(most / 2)
    limit = "a + 2c/N: what half as many samples must cost"
    return [
        largest_z(f"excess over LQG less Σ ½ S e_k², N = {SAMPLES[0]} to {most}", drawn, freedom),
        largest_z(
            f"Σ ½ S e_k² less a + c/N, N = {SAMPLES[0]} to {most}, next term allowed for",
            off,
            freedom,
        ),
        _slope(forms, expected),
        _floor(forms, expected),
        at_most(
            f"excess at N = {most}, % of the optimum, upper end",
            100 * upper / best,
            100 * half / best,
            limit,
        ),
    ]


def _slope(forms: np.ndarray, expected: Expected) -> Check:
    """d log(excess - a) / d log N from the second N to the last."""
    (few, many), span = (
        (forms[1] - expected.floor, forms[-1] - expected.floor),
        math.log(SAMPLES[-1] / SAMPLES[1]),
    )
    slope = math.log(many.mean() / few.mean()) / span
    error = standard_error(many / many.mean() - few / few.mean()) / span
    tolerance = quantile(1, len(few) - 1) * error + expected.next_term / SAMPLES[1] / span
    computed = f"slope of log(excess - a) over log N, N = {SAMPLES[1]} to {SAMPLES[-1]}"
    return near(
        computed, slope, -1.0, tolerance, "1/N; standard errors, and the next term at the smaller N"
    )


def _floor(forms: np.ndarray, expected: Expected) -> Check:
    """The excess for N -> infinity, c/N taken off by the last two N."""
    ratio = SAMPLES[-1] / SAMPLES[-2]
    limits = (ratio * forms[-1] - forms[-2]) / (ratio - 1)
    left = expected.per_sample * expected.next_term / SAMPLES[-1] / SAMPLES[-2]
    computed = f"excess for N → ∞, from N = {SAMPLES[-2]} and {SAMPLES[-1]}, against a"
    return within_errors(
        computed,
        float(limits.mean()),
        expected.floor,
        standard_error(limits),
        len(limits) - 1,
        float(left),
    )


def _excess_panel(paired: np.ndarray, forms: np.ndarray, expected: Expected, best: float) -> Panel:
    grid = np.geomspace(SAMPLES[0], SAMPLES[-1], 60)
    lines = [
        Line("a + c/N, predicted", list(grid), list(100 * expected.excess(grid) / best)),
        Line("a: N → ∞", [SAMPLES[0], SAMPLES[-1]], [100 * expected.floor / best] * 2, "dashed"),
        _points("cost less that of LQG, same noise", paired, best),
        _points("quadratic form of the control errors", forms, best),
    ]
    return Panel(
        "Excess cost of Algorithm 1", "samples N", "excess cost (% of the optimum)", lines, "xy"
    )


def _points(label: str, excess: np.ndarray, best: float) -> Line:
    """Means over trials with intervals, in per cent of the optimum; a log axis shows those that reach below zero down
    to a tenth of the mean, and none whose mean is below."""
    means, freedom = excess.mean(axis=1), excess.shape[1] - 1
    half = np.array([standard_error(row) for row in excess]) * quantile(1, freedom)
    bottom = np.where(half < means, means - half, means / 10)
    per_cent = 100 * np.array([means, bottom, means + half]) / best
    x, y, low, high = (list(v[means > 0]) for v in (np.array(SAMPLES), *per_cent))
    return Line(label, x, y, "points", low, high)


def _loop_panel(runs: Sequence[Loops], lqg: Loops) -> Panel:
    times = list(DT * np.arange(STEPS))
    lines = [
        Line(f"Algorithm 1, N = {SAMPLES[i]}", times, list(runs[i].mean[0])) for i in (0, 2, -1)
    ]
    lines.append(Line("LQG", times, list(lqg.mean[0]), "dashed"))
    return Panel("One closed loop, the same noise", "time t (s)", "belief mean μ", lines)
