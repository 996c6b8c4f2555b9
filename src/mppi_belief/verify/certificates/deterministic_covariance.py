"""Where f and c are linear and G is constant, the covariance is known in advance (Proposition 2).

    dSigma/dt = A Sigma + Sigma A' + Q - Sigma C' R_o^-1 C Sigma                          (8b)(11)
    K = Sigma C' R_o^-1,    D = K R_o K'                                                  (8a)(9)

The package's discrete recursion tends to this at first order in dt, does not depend on controls or measurements,
and settles at the algebraic Riccati equations' solutions. No relative error grows: for an error E with
-e Sigma <= E <= e Sigma the flow of (8b), concave, increasing and not negative at zero, keeps e from growing, and so
does its discrete form. Errors of relative size e at each step thus add up to at most (steps) (condition of Sigma) e.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_continuous_are, solve_discrete_are

from ...belief.kalman import predict
from ...belief.prior import prior
from ...belief.riccati import kalman_bucy_gain, riccati_rate
from ...belief.schedule import GainSchedule, gain_schedule
from ...controllers import LQG
from ...costs import GoalObstacleCost
from ...filters import EKF
from ...problem import Belief, Problem, System
from ...results.certificate import Certificate, Check, Line, Panel
from ...simulate import simulate_trial
from ...systems import LightDark, Linear
from ..bands import EPSILON, at_least, at_most, order, rounding

Reals = NDArray[np.float64]
Schedule = Callable[..., GainSchedule]

# position, velocity and a wind that comes and goes; what is seen is the position, and roughly the airspeed
A = np.array([[0.0, 1.0, 0.0], [0.0, -0.2, 1.0], [0.0, 0.0, -0.5]])
B = np.array([[0.0], [1.0], [0.0]])
C = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -0.3]])
H = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.4]])
SENSOR = np.array([0.3, 0.5])
Q, R_O = H @ H.T, np.diag(SENSOR**2)

DURATION, STEPS, PIECES = (
    1.0,
    20,
    (1, 2, 4, 8, 16),
)  # a schedule is made in pieces of STEPS, which compile once
LOCAL = 1e-12  # what the reference's integrator may be off by in a step
REPEATS = 20  # control sequences, and trials
SETTLED, DT = 50, 0.1  # pieces and time step after which nothing changes
OPERATIONS = 200  # roundings of an entry of Sigma in a step: a matrix exponential takes some 20 products, n terms each


class Reference(NamedTuple):
    """Sigma, K and D at T by an integrator, a bound of Sigma's error, the largest condition number on the way."""

    cov: Reals
    gain: Reals
    diffusion: Reals
    error: float
    condition: float


def problem_of(system: System, dt: float, mean: Array, std: Array, nu: int) -> Problem:
    """A system with some quadratic cost, STEPS steps of it."""
    ones = jnp.ones(len(mean))
    cost = GoalObstacleCost(0 * ones, ones, ones, jnp.ones(nu))
    return Problem(system, cost, mean, std, dt, STEPS, noise_convention="intensity")


def linear(dt: float) -> Problem:
    """The linear system."""
    a, b, c, channel, sensor = map(jnp.asarray, (A, B, C, H, SENSOR))
    system = Linear(a, b, c, channel, sensor)
    return problem_of(system, dt, jnp.zeros(3), jnp.array([0.5, 0.4, 0.3]), 1)


def light_dark(dt: float) -> Problem:
    """The light-dark system of Sec. VII, seen better the nearer it is to the light."""
    system = LightDark(0.3, 5.0, 0.5**0.5, 0.1)
    return problem_of(
        system, dt, jnp.array([1.0, 1.0, 0.0, 0.0]), jnp.array([0.2, 0.2, 0.05, 0.05]), 2
    )


def along(schedule: Schedule, problem: Problem, pieces: int, method: str) -> GainSchedule:
    """The last piece of a schedule without controls."""
    at = prior(problem)
    for _ in range(pieces):
        found = schedule(problem, at, jnp.zeros((STEPS, 1)), method)
        at = Belief(found.mean[-1], found.cov[-1])
    return found


def reference() -> Reference:
    """(8b) by DOP853; its local errors add up as the module says."""
    start = np.asarray(prior(linear(DT)).cov)
    rate = jax.jit(lambda cov: riccati_rate(cov, *map(jnp.asarray, (A, Q, C, R_O))))

    def flat(_: float, cov: Reals) -> Reals:
        return np.asarray(rate(cov.reshape(start.shape))).ravel()

    found = solve_ivp(
        flat, (0, DURATION), start.ravel(), method="DOP853", rtol=LOCAL, atol=LOCAL * start.max()
    )
    covs = found.y.T.reshape(-1, *start.shape)
    K, D = kalman_bucy_gain(jnp.asarray(covs[-1]), jnp.asarray(C), jnp.asarray(R_O))
    condition = float(np.max(np.linalg.cond(covs)))
    error = len(covs) * condition * 2 * LOCAL * len(start) * norm(covs[-1])
    return Reference(covs[-1], np.asarray(K), np.asarray(D), error, condition)


def norm(M: Reals) -> float:
    """The largest singular value."""
    return float(np.linalg.norm(M, 2))


def distance(found: Array | Reals, truth: Reals) -> float:
    """Frobenius norm of the difference."""
    return float(np.linalg.norm(np.asarray(found) - truth))


def limits(schedule: Schedule) -> tuple[list[Check], Panel]:
    """Sigma, K / dt and D of the discrete filter as dt goes to zero, and the exact step at every dt."""
    exact, exact_step = reference(), []
    truth = {"Σ": exact.cov, "K/Δt": exact.gain, "D": exact.diffusion}
    values: dict[str, list[Reals]] = {name: [] for name in truth}
    steps = [DURATION / (pieces * STEPS) for pieces in PIECES]
    for pieces, dt in zip(PIECES, steps, strict=True):
        found = along(schedule, linear(dt), pieces, "filter")
        for name, value in zip(
            truth, (found.cov[-1], found.gain[-1] / dt, found.diffusion[-1]), strict=True
        ):
            values[name].append(np.asarray(value))
        exact_step.append(
            distance(along(schedule, linear(dt), pieces, "riccati").cov[-1], exact.cov)
        )
    errors = {name: [distance(value, truth[name]) for value in values[name]] for name in truth}
    rounded = PIECES[-1] * STEPS * exact.condition * OPERATIONS * EPSILON * norm(exact.cov)
    said = "Σ at T by the exact Riccati step, 20 to 320 steps, against an integrator"
    derived = "(local error)(steps)(condition of Σ); no relative error of Σ grows"
    checks = [
        order("order in Δt of the discrete filter's Σ at T against (8b)", 1, errors["Σ"]),
        extrapolation(values, truth),
        at_most(said, max(exact_step), exact.error + rounded, derived),
    ]
    lines = [Line(name, steps, off) for name, off in errors.items()]
    lines.append(
        Line("order 1", steps, [1.6 * errors["Σ"][0] * dt / steps[0] for dt in steps], "dashed")
    )
    return checks, Panel(
        "The discrete filter tends to (8b)(9)", "Δt (s)", "error at T (Frobenius)", lines, "xy"
    )


def extrapolation(values: dict[str, list[Reals]], truth: dict[str, Reals]) -> Check:
    """The limits themselves: an order is not much disturbed by a limit that is off by less than the last error."""
    ratios = []
    for name, found in values.items():
        before, last = (2 * found[j] - found[j - 1] for j in (-2, -1))
        ratios.append(distance(last, truth[name]) / distance(last, before))
    said = "extrapolated limits of Σ, K/Δt, D: distance from (8b)(9) over their last change"
    return at_most(
        said,
        max(ratios),
        2 / 3,
        "of second order: a third of the last change is missing; twice that",
    )


def under_controls(problem: Problem, controls: Array) -> GainSchedule:
    """The filter's schedules for each of controls (N, STEPS, nu), by the same compiled operations."""
    at = prior(problem)
    return jax.jit(lambda each: jax.lax.map(lambda u: gain_schedule(problem, at, u), each))(
        controls
    )


def differing(parts: Reals) -> int:
    """How many entries of (N, ...) are not the same bits in all N."""
    return int(np.sum(np.any(parts != parts[:1], axis=0)))


def independence(problem: Problem, seed: int) -> list[Check]:
    """Neither controls nor measurements matter for the linear system."""
    rng = np.random.default_rng(seed)
    planned = under_controls(problem, jnp.asarray(rng.normal(size=(REPEATS, STEPS, 1)) * 5))
    run = partial(simulate_trial, problem, EKF(), LQG(0, at_step_end=False), seed)
    looped = jax.jit(lambda numbers: jax.lax.map(run, numbers))(jnp.arange(REPEATS)).beliefs.cov
    bits = sum(
        differing(np.asarray(part))
        for part in (planned.cov, planned.gain, planned.diffusion, looped)
    )
    covs = np.asarray(looped)
    kalman = recursion(covs[0, 0], STEPS)
    apart = np.max(np.linalg.norm(covs - kalman, axis=(-2, -1)))
    said = f"entries that differ in a bit: Σ, K, D over {REPEATS} control sequences, Σ over {REPEATS} closed loops"
    return [
        at_most(said, bits, 0, "nothing that is random enters: the same operations"),
        rounding(
            "EKF's Σ in closed loop against NumPy's recursion",
            apart,
            2 * amplified(kalman),
            max(map(norm, kalman)),
        ),
    ]


def recursion(cov: Reals, steps: int) -> Reals:
    """The Kalman filter's covariances (steps + 1, nx, nx) of the linear system, by NumPy."""
    covs, F = [cov], np.eye(len(cov)) + A * DT
    for _ in range(steps):
        ahead = F @ covs[-1] @ F.T + Q * DT
        covs.append(ahead - ahead @ C.T @ np.linalg.solve(C @ ahead @ C.T + R_O / DT, C @ ahead))
    return np.array(covs)


def transient(schedule: Schedule) -> list[Check]:
    """K and D of both schedules belong to the Sigma of their step, on the way from the prior.

    (9) of the discrete filter is what a measurement takes off the covariance; (8a)(9) of the other are those at t_k.
    """
    filtered, flowed = (along(schedule, linear(DT), 1, method) for method in ("filter", "riccati"))
    F, before, after = (
        np.eye(len(A)) + A * DT,
        np.asarray(filtered.cov)[:-1],
        np.asarray(filtered.cov)[1:],
    )
    ahead = F @ before @ F.T + Q * DT
    S, now = C @ ahead @ C.T + R_O / DT, np.asarray(flowed.cov)[:-1]
    taken = relative(np.asarray(filtered.diffusion) * DT, ahead - after, ahead)
    gained = relative(np.asarray(filtered.gain) @ S, ahead @ C.T, ahead)
    K = now @ C.T @ np.linalg.inv(R_O)
    held = max(
        relative(np.asarray(flowed.gain), K, K),
        relative(np.asarray(flowed.diffusion), K @ C @ now, K @ C @ now),
    )
    return [
        rounding(
            "filter's schedule: K S = Σ⁻C', D Δt = what a measurement takes off Σ⁻; relative",
            max(taken, gained),
            np.ceil(OPERATIONS * np.max(np.linalg.cond(S))),
        ),
        rounding(
            "Riccati schedule: K, D against ΣC'R_o⁻¹, ΣC'R_o⁻¹CΣ at the same t_k, relative",
            held,
            np.ceil(OPERATIONS * np.linalg.cond(R_O)),
        ),
    ]


def relative(found: Reals, truth: Reals, size: Reals) -> float:
    """Largest difference (T, m, n) over the norms of (T, ., .)."""
    apart, sizes = (np.linalg.norm(part, axis=(1, 2)) for part in (found - truth, size))
    return float(np.max(apart / sizes))


def amplified(covs: Reals) -> float:
    """Roundings of Sigma, relative to its norm, after the steps of covs (T+1, nx, nx)."""
    return float(np.ceil((len(covs) - 1) * np.max(np.linalg.cond(covs)) * OPERATIONS))


def steered(seed: int) -> Check:
    """What rounding cannot explain: where the noise depends on the state, controls move the covariance."""
    rng = np.random.default_rng(seed)
    controls = np.repeat(rng.normal(size=(REPEATS, 1, 2)) * 3, STEPS, axis=1)
    covs = np.asarray(under_controls(light_dark(DT), jnp.asarray(controls)).cov)
    traces = np.trace(covs[:, -1], axis1=-2, axis2=-1)
    rounded = (
        max(2 * amplified(each) * each.shape[-1] * max(map(norm, each)) for each in covs) * EPSILON
    )
    said = "light-dark: spread of tr Σ at T over random controls"
    return at_least(said, np.ptp(traces), rounded, "what rounding could make of equal traces")


def settled(schedule: Schedule) -> list[Check]:
    """The steady states against SciPy's algebraic Riccati equations.

    A step changes an error E into Phi E Phi' and adds its rounding, so that what stays is the rounding over the
    least singular value of 1 - Phi x Phi.
    """
    problem = linear(DT)
    F = np.eye(3) + A * DT
    continuous, discrete = (
        solve_continuous_are(A.T, C.T, Q, R_O),
        solve_discrete_are(F.T, C.T, Q * DT, R_O / DT),
    )
    flowed = along(schedule, problem, SETTLED, "riccati").cov[-1]
    filtered = along(schedule, problem, SETTLED, "filter")
    ahead = predict(problem, Belief(filtered.mean[-1], filtered.cov[-1]), jnp.zeros(1)).cov
    K = discrete @ C.T @ np.linalg.inv(C @ discrete @ C.T + R_O / DT)
    checks = []
    for name, found, truth, Phi in (
        (
            "Riccati step, settled, against the continuous algebraic equation",
            flowed,
            continuous,
            flow(continuous),
        ),
        (
            "discrete filter, settled and predicted, against the discrete one",
            ahead,
            discrete,
            F @ (np.eye(3) - K @ C),
        ),
    ):
        separation = np.linalg.svd(np.eye(9) - np.kron(Phi, Phi), compute_uv=False)[-1]
        checks.append(
            rounding(
                name, distance(found, truth), np.ceil(2 * OPERATIONS / separation), norm(truth)
            )
        )
    return checks


def flow(cov: Reals) -> Reals:
    """What a step DT of the steady filter does to an error of its mean."""
    return np.asarray(expm((A - cov @ C.T @ np.linalg.inv(R_O) @ C) * DT))


def certify(seed: int = 0) -> Certificate:
    """The certificate; `seed` draws controls and measurements."""
    schedule = jax.jit(gain_schedule, static_argnames="method")
    checks, panel = limits(schedule)
    text = (
        "For a linear system with three states the package's filter recursion is refined in time, run under random"
        " controls and in closed loops, and left to settle. Covariance, gain and diffusion tend to Proposition 2's"
        " at first order, and not one bit of them depends on controls or measurements. This holds for linear f and c,"
        " constant G and constant noise: in the light-dark system the covariance depends on the controls, through where"
        " the vehicle goes."
    )
    name, statement = "deterministic_covariance", "Proposition 2, deterministic covariance"
    checks = [
        *checks,
        *transient(schedule),
        *independence(linear(DT), seed),
        *settled(schedule),
        steered(seed),
    ]
    return Certificate(name, statement, text, checks, [panel])
