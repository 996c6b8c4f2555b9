"""A linear system on which the grid filter must agree with the Kalman filters (5)(6).

    dpi = a^u(pi) dt + b(pi) dy~,   a^u = a^0 - (G u pi)',   b = pi (c - pi(c)) R_o^-1

Where c is linear, the solution of (5) is Gaussian.
"""

import jax
import jax.numpy as jnp
import numpy as np

from ...belief.prior import prior
from ...belief.riccati import kalman_bucy_gain
from ...belief.schedule import gain_schedule
from ...filters import EKF
from ...problem import Problem
from ...results.certificate import Check
from ...systems import ScalarLinear
from ..bands import observed_orders, order, within_errors
from ..estimates import rms
from ..solvers.kushner import Moments, Reals, extrapolated_moments
from .scalar_paths import (
    CONTROL_PIECES,
    PRIOR_MEAN,
    cosine_controls,
    filter_moments,
    grid_filter_moments,
    simulated_measurements,
    uncosted_problem,
)

LINE_A = -0.5
LINE_B = 0.8
LINE_C = 1.2
SIGMA_W = 0.6
SIGMA_O = 0.4
FINE_STEPS = 4096  # of the simulated paths
FILTER_STEPS = (CONTROL_PIECES, 64, 128, 256)  # of the grid filters
LINEAR_PATHS = 128
LINE_DURATION = 2.0  # of the simulated paths


def rms_over(deviation: Reals, axis: int | tuple[int, ...]) -> Reals:
    """Returns the root mean square over some axes."""
    return np.asarray(np.sqrt(np.mean(deviation**2, axis=axis)))


def linear_problem(drift: float, duration: float, steps: int) -> Problem:
    """Returns the linear system with another drift, or with the drift A."""
    system = ScalarLinear(drift, LINE_B, LINE_C, SIGMA_W, SIGMA_O)
    return uncosted_problem(system, duration, steps)


def smooth_measurements(problem: Problem) -> Reals:
    """Returns measurements (T, 1) without noise.

    Filters must agree on any measurements, and on smooth ones errors expand in powers of h and dt.
    """
    time = problem.dt * (np.arange(problem.steps) + 0.5)
    return 0.5 + np.sin(4 * time)[:, None]


def space_order_checks() -> list[Check]:
    """Returns checks of the grid filter's order in h against the discrete Kalman filter.

    Without drift, the prediction is exact in mean and variance on the grid too. Only the density's
    fourth cumulant, wrong by O(h^2), distinguishes the grid from the Kalman filter at the same dt.
    """
    problem = linear_problem(0.0, 1.0, 128)
    y = smooth_measurements(problem)
    kalman = jax.jit(lambda y: filter_moments(problem, EKF(), y, jax.random.key(0)))(jnp.asarray(y))
    by_cells = [
        grid_filter_moments(problem, cells, y * problem.dt, substeps=8) for cells in (60, 120, 240)
    ]
    means, variances = (
        [float(rms(moments[j][:, 0] - exact)) for moments in by_cells]
        for j, exact in enumerate(kalman)
    )
    return [
        order(
            "c linear: order in h of the grid's mean against the discrete Kalman filter's", 2, means
        ),
        order(
            "c linear: order in h of the grid's variance against the discrete Kalman filter's",
            2,
            variances,
        ),
    ]


def kalman_bucy_moments(problem: Problem, dy: Reals) -> Moments:
    """Returns (8a)(8b) for increments dy (T, P) that arrive evenly within each step.

    The error O(dt^2) is that of the mean alone.
    """
    system = problem.system
    dt = problem.dt
    u = cosine_controls(problem.steps)
    schedule = jax.jit(gain_schedule, static_argnames="method")(
        problem, prior(problem), jnp.asarray(u)[:, None], "riccati"
    )
    R_o = system.sigma_o(schedule.mean[-1]) ** 2
    last_gain, _ = kalman_bucy_gain(schedule.cov[-1], jnp.array([[LINE_C]]), R_o)
    K = np.append(np.asarray(schedule.gain).ravel(), last_gain)

    # The trapezoidal rule for the mean.
    mean = np.full((problem.steps + 1, dy.shape[1]), PRIOR_MEAN)
    half_rate = (LINE_A - K * LINE_C) * problem.dt / 2
    push = LINE_B * u * dt
    for k in range(problem.steps):
        explicit = (1 + half_rate[k]) * mean[k] + (K[k] + K[k + 1]) / 2 * dy[k] + push[k]
        mean[k + 1] = explicit / (1 - half_rate[k + 1])
    return Moments(mean, np.asarray(schedule.cov)[:, 0])


def time_order_checks(seed: int) -> list[Check]:
    """Returns checks of the grid filter's order in dt against Kalman-Bucy.

    The error in h is extrapolated away; both filters see the same finely sampled paths.
    """
    problem = linear_problem(LINE_A, LINE_DURATION, FINE_STEPS)
    simulate = jax.jit(jax.vmap(lambda path: simulated_measurements(problem, seed, path)))
    y = simulate(jnp.arange(LINEAR_PATHS))
    dy = np.asarray(y)[..., 0].T * problem.dt
    exact = kalman_bucy_moments(problem, dy)
    errors = [_errors_in_steps(steps, dy, exact) for steps in FILTER_STEPS]
    mean_errors = [mean for mean, _ in errors]
    variance_errors = [variance for _, variance in errors]

    # The order of each path's error, and its mean over the paths.
    orders = np.array([observed_orders(list(path)) for path in np.transpose(mean_errors)]).T
    error = orders[-1].std(ddof=1) / np.sqrt(LINEAR_PATHS)
    # Errors are C dt (1 + O(dt times the rate at which the filter forgets)).
    forgetting = abs(LINE_A) + LINE_C**2 * exact.variance.max() / SIGMA_O**2
    bias = forgetting * LINE_DURATION / FILTER_STEPS[-2]
    return [
        order(
            "c linear: order in dt of the grid's variance against Kalman-Bucy (8b)",
            1,
            variance_errors,
        ),
        within_errors(
            "c linear: order in dt of the grid's mean against Kalman-Bucy (8a), mean over paths",
            orders[-1].mean(),
            1,
            error,
            LINEAR_PATHS - 1,
            float(bias),
        ),
    ]


def _errors_in_steps(steps: int, dy: Reals, exact: Moments) -> tuple[Reals, float]:
    """Returns RMS errors of the grid filter in `steps` steps: of mean (P,) and variance ().

    `dy` (FINE_STEPS, P) are the increments of the paths and `exact` the moments of Kalman-Bucy;
    errors are taken at the times of the coarsest filter.
    """
    problem = linear_problem(LINE_A, LINE_DURATION, steps)
    summed = dy.reshape(steps, -1, LINEAR_PATHS).sum(axis=1)
    sampled = extrapolated_moments(
        *(grid_filter_moments(problem, cells, summed) for cells in (120, 240))
    )
    smooth_dy = smooth_measurements(problem) * problem.dt
    smooth = extrapolated_moments(
        *(grid_filter_moments(problem, cells, smooth_dy) for cells in (240, 480))
    )
    every = slice(None, None, steps // FILTER_STEPS[0])
    every_exact = slice(None, None, FINE_STEPS // FILTER_STEPS[0])
    mean_error = rms_over(sampled.mean[every] - exact.mean[every_exact], axis=0)
    return mean_error, float(rms(smooth.variance[every] - exact.variance[every_exact]))
