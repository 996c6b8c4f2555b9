"""The belief obeys the Kushner-Stratonovich equation (5), its control and its innovation act through (6a)(6b).

    dpi = a^u(pi) dt + b(pi) dy~,   a^u = a^0 - (G u pi)',   b = pi (c - pi(c)) R_o^-1

On a line (5) is solved on a grid (`kushner`). Where c is linear its solution is Gaussian and the Kalman filters
must agree with it; where c is curved, c(x) = x + kappa x^2 / 2, the extended Kalman filter errs, for small kappa

* in its mean by O(kappa), as it leaves out kappa Sigma / 2 in pi(c);
* in its variance by O(kappa), as it leaves out what (6b) does to the variance, kappa Sigma^2 R_o^-1 dy~.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...belief.prior import prior
from ...belief.riccati import kalman_bucy_gain
from ...belief.schedule import gain_schedule
from ...filters import EKF, ParticleFilter
from ...problem import Problem
from ...results.certificate import Certificate, Check, Line, Panel
from ...simulate import FILTER, role_key
from ...systems import ScalarLinear
from .. import kushner
from ..bands import at_least, largest_z, observed_orders, order, rounding, within_errors
from ..compilation import quick_jit
from ..estimates import rms
from ..kushner import Moments, Reals, extrapolated
from ..scalar_paths import (
    HELD,
    PRIOR_MEAN,
    PRIOR_STD,
    REACH,
    Curved,
    controls_of,
    filtered,
    measured,
    on_grid,
    problem_of,
)

A, B, C, SIGMA_W, SIGMA_O = -0.5, 0.8, 1.2, 0.6, 0.4  # the linear system
FINE, COARSE, LINEAR_PATHS = 4096, (HELD, 64, 128, 256), 128  # steps of the path and of the filters
STEPS, PATHS, PARTICLES = 32, 64, 500  # of the curved measurement
SETTLED = 8  # steps after which the prior is forgotten
CURVATURES = (0.01, 0.02, 0.04, 0.08, 0.4, 1.6)
SMALL, SAMPLED = (
    slice(3, None, -1),
    [3, 4, 5],
)  # those that show the order, those of the particle filter


def rms_over(deviation: Reals, axis: int | tuple[int, ...]) -> Reals:
    """Root of the mean square over some axes."""
    return np.asarray(np.sqrt(np.mean(deviation**2, axis=axis)))


# The linear case


def linear(drift: float, duration: float, steps: int) -> Problem:
    """The linear system of this certificate."""
    return problem_of(ScalarLinear(drift, B, C, SIGMA_W, SIGMA_O), duration, steps)


def curved(curvature: Array | float) -> Problem:
    """The system with a curved measurement."""
    return problem_of(Curved(curvature, 0.5, 0.3), 1.0, STEPS)


def smooth_record(problem: Problem) -> Reals:
    """Measurements (T, 1) that no noise made: filters agree on any, and errors expand in powers of h and dt."""
    time = problem.dt * (np.arange(problem.steps) + 0.5)
    return 0.5 + np.sin(4 * time)[:, None]


def space_orders() -> list[Check]:
    """Without drift the filter's prediction is exact in mean and variance on the grid too, so that only the
    density's fourth cumulant, wrong by O(h^2), tells the grid from the discrete Kalman filter at the same dt."""
    problem = linear(0.0, 1.0, 128)
    y = smooth_record(problem)
    kalman = jax.jit(lambda y: filtered(problem, EKF(), y, jax.random.key(0)))(jnp.asarray(y))
    found = [on_grid(problem, cells, y * problem.dt, substeps=8) for cells in (60, 120, 240)]
    means, variances = (
        [float(rms(part[j][:, 0] - exact)) for part in found] for j, exact in enumerate(kalman)
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


def kalman_bucy_path(problem: Problem, dy: Reals) -> Moments:
    """(8a)(8b) for increments dy (T, P) that arrive evenly within each step; error O(dt^2), of the mean alone."""
    system, dt, u = problem.system, problem.dt, controls_of(problem.steps)
    found = jax.jit(gain_schedule, static_argnames="method")(
        problem, prior(problem), jnp.asarray(u)[:, None], "riccati"
    )
    last, _ = kalman_bucy_gain(found.cov[-1], jnp.array([[C]]), system.sigma_o(found.mean[-1]) ** 2)
    K = np.append(np.asarray(found.gain).ravel(), last)
    mean = np.full((problem.steps + 1, dy.shape[1]), PRIOR_MEAN)
    rate, push = (A - K * C) * problem.dt / 2, B * u * dt
    for k in range(problem.steps):
        driven = (1 + rate[k]) * mean[k] + (K[k] + K[k + 1]) / 2 * dy[k] + push[k]
        mean[k + 1] = driven / (1 - rate[k + 1])
    return Moments(mean, np.asarray(found.cov)[:, 0])


def time_orders(seed: int) -> list[Check]:
    """The grid filter, its error in h extrapolated away, against Kalman-Bucy on the same finely sampled paths."""
    duration = 2.0
    problem = linear(A, duration, FINE)
    y = jax.jit(jax.vmap(lambda path: measured(problem, seed, path)))(jnp.arange(LINEAR_PATHS))
    dy = np.asarray(y)[..., 0].T * problem.dt
    exact = kalman_bucy_path(problem, dy)
    means, variances = [], []
    for steps in COARSE:
        summed = dy.reshape(steps, -1, LINEAR_PATHS).sum(axis=1)
        coarse = linear(A, duration, steps)
        found = extrapolated(*(on_grid(coarse, cells, summed) for cells in (120, 240)))
        smooth = extrapolated(
            *(on_grid(coarse, cells, smooth_record(coarse) * coarse.dt) for cells in (240, 480))
        )
        at, of = slice(None, None, steps // COARSE[0]), slice(None, None, FINE // COARSE[0])
        means.append(rms_over(found.mean[at] - exact.mean[of], axis=0))
        variances.append(float(rms(smooth.variance[at] - exact.variance[of])))
    orders = np.array([observed_orders(list(path)) for path in np.transpose(means)]).T
    error = orders[-1].std(ddof=1) / np.sqrt(LINEAR_PATHS)
    # errors are C dt (1 + O(dt times the rate at which the filter forgets))
    bias = (abs(A) + C**2 * exact.variance.max() / SIGMA_O**2) * duration / COARSE[-2]
    said = "c linear: order in dt of the grid's mean against Kalman-Bucy (8a), mean over paths"
    return [
        order(
            "c linear: order in dt of the grid's variance against Kalman-Bucy (8b)", 1, variances
        ),
        within_errors(said, orders[-1].mean(), 1, error, LINEAR_PATHS - 1, float(bias)),
    ]


# The channels


def channel_check(u: float = 0.7) -> Check:
    """Both channels keep the mass; (6a) moves the mean by A mu + B u, (6b) by the gain K of (8a)."""
    problem = linear(A, 1.0, 1)
    on = kushner.grid(-REACH, REACH, 400)
    model = kushner.coefficients(problem, on)
    p, c = kushner.gaussian(on, PRIOR_MEAN, PRIOR_STD**2)[:, None], model.c[:, None]
    bands = kushner.generator(on, model, u)
    a, b = kushner.drift_channel(bands, p), kushner.diffusion_channel(on, p, c, model.R_o)
    rounded_a, rounded_b = (
        kushner.drift_channel(np.abs(bands), p),
        p * (np.abs(c) + C * PRIOR_MEAN) / model.R_o,
    )
    K, _ = kalman_bucy_gain(prior(problem).cov, jnp.array([[C]]), jnp.array([[model.R_o]]))
    off = []
    for channel, rounded, moved in (
        (a, rounded_a, A * PRIOR_MEAN + B * u),
        (b, rounded_b, float(K[0, 0])),
    ):
        for test, expected in ((np.ones_like(on.x), 0.0), (on.x, moved)):
            off.append(
                abs(test @ channel[:, 0] * on.h - expected) / (np.abs(test) @ rounded[:, 0] * on.h)
            )
    said = "(6a)(6b): mass made, and mean moved against Aμ + Bu and K, relative to what is summed"
    return rounding(said, float(np.max(off)), len(on.x))


def drift_in_closed_form(x: Reals, u: float, Q: float) -> Reals:
    """(6a) for the density of the prior, f = -sin x and G = 1 + 0.3 cos x: -((f + G u) pi)' + Q pi'' / 2."""
    variance = PRIOR_STD**2
    away = (x - PRIOR_MEAN) / variance
    pi = np.exp(-(away**2) * variance / 2) / np.sqrt(2 * np.pi * variance)
    drift, slope = -np.sin(x) + (1 + 0.3 * np.cos(x)) * u, -np.cos(x) - 0.3 * np.sin(x) * u
    return np.asarray((drift * away - slope + Q / 2 * (away**2 - 1 / variance)) * pi)


def step_orders(u: float = 0.8) -> list[Check]:
    """One step of the grid filter with the innovations +-sqrt(R_o dt): half the sum of the two densities moves by
    a^u dt + O(dt^2) + O(dt h^2), half their difference is b sqrt(R_o dt) + O(dt^(3/2)); f, G and c are all curved."""
    drift, diffusion = [], []
    for finer in range(4):
        on, dt = kushner.grid(-REACH, REACH, 100 * 2**finer), 0.032 / 4.0**finer
        model = kushner.coefficients(replace(curved(0.8), dt=dt), on)._replace(
            f=-np.sin(on.x), G=1 + 0.3 * np.cos(on.x)
        )
        p, c = kushner.gaussian(on, PRIOR_MEAN, PRIOR_STD**2)[:, None], model.c[:, None]
        a, b = (
            drift_in_closed_form(on.x, u, model.Q),
            kushner.diffusion_channel(on, p, c, model.R_o),
        )
        dy = np.sum(p * c) * on.h * dt + np.sqrt(model.R_o * dt) * np.array([1.0, -1.0])
        after = kushner.observe(
            on, kushner.transport(kushner.generator(on, model, u), p, dt), c, model.R_o, dy, dt
        )
        drift.append(rms((after.mean(axis=1) - p[:, 0]) / dt - a))
        half = (after[:, :1] - after[:, 1:]) / 2
        diffusion.append(rms(half / np.sqrt(model.R_o * dt) - b))
    return [
        order(
            "order in h, dt ~ h², of one step's density, mean over dỹ = ±√(R_o dt), against (6a)",
            2,
            drift,
        ),
        order(
            "order in h, dt ~ h², of one step's density, half difference over ±, against b of (6b)",
            2,
            diffusion,
        ),
    ]


# The curved measurement


def curved_case(seed: int) -> tuple[list[Check], list[Panel]]:
    """EKF and particle filter against the grid for c(x) = x + kappa x^2 / 2, on paths of the same noise."""

    def one(curvature: Array, path: Array) -> tuple[Array, tuple[Array, Array]]:
        problem = curved(curvature)
        y = measured(problem, seed, path)
        return y, filtered(problem, EKF(), y, jax.random.key(0))

    def particles(curvature: Array, path: Array, y: Array) -> tuple[Array, Array]:
        many = ParticleFilter(PARTICLES, resample_below=0.5, noise_at="particle")
        return filtered(curved(curvature), many, y, role_key(seed, path, FILTER))

    curvatures, paths = jnp.array(CURVATURES), jnp.arange(PATHS)
    y, ekf = quick_jit(jax.vmap(jax.vmap(one, (None, 0)), (0, None)))(curvatures, paths)
    run = quick_jit(jax.vmap(jax.vmap(particles, (None, 0, 0)), (0, None, 0)))
    sampled = run(curvatures[jnp.array(SAMPLED)], paths, y[jnp.array(SAMPLED)])
    coarse, fine = (
        curved_grid(np.asarray(y)[..., 0], cells, substeps)
        for cells, substeps in ((250, 1), (500, 2))
    )
    exact = extrapolated(coarse, fine)
    own = Moments(*(np.abs(e - f) for e, f in zip(exact, fine, strict=True)))
    ekf, sampled = Moments(*map(np.asarray, ekf)), Moments(*map(np.asarray, sampled))
    checks = [particle_check(sampled, exact, own), *ekf_checks(ekf, exact, own)]
    return checks, [error_panel(ekf, sampled, exact), path_panel(ekf, sampled, exact)]


def worse_from(panel: Panel) -> float:
    """The least kappa tried from which on the EKF's mean is farther off than the particle filter's."""
    ekf, _, particles, _ = panel.lines
    errors = dict(zip(ekf.x, ekf.y, strict=True))
    below = [
        kappa
        for kappa, error in zip(particles.x, particles.y, strict=True)
        if errors[kappa] <= error
    ]
    return min(
        (kappa for kappa in particles.x if kappa > max(below, default=0.0)), default=float("inf")
    )


def curved_grid(y: Reals, cells: int, substeps: int) -> Moments:
    """The grid filter's moments, each (curvatures, P, T+1), for measurements (curvatures, P, T)."""
    problem = curved(0.0)
    x = kushner.grid(-REACH, REACH, cells).x[:, None]
    c = x + np.repeat(CURVATURES, y.shape[1]) * x**2 / 2
    found = on_grid(problem, cells, y.reshape(-1, STEPS).T * problem.dt, c, substeps)
    return Moments(*(part.T.reshape(*y.shape[:2], -1) for part in found))


def particle_check(sampled: Moments, exact: Moments, own: Moments) -> Check:
    """What the particle filter is off by on average over time, mean over the paths. Its bias of O(1 / particles) is
    a small part of the standard error, O(1 / root(particles paths))."""
    sd, scores = np.sqrt(exact.variance[SAMPLED]), []
    for found, truth, bias, unit in zip(sampled, exact, own, (sd, sd**2), strict=True):
        off, bound = (
            part[:, :, SETTLED:].mean(axis=2)
            for part in ((found - truth[SAMPLED]) / unit, bias[SAMPLED] / unit)
        )
        error = off.std(axis=1, ddof=1) / np.sqrt(PATHS)
        scores.append(np.maximum(np.abs(off.mean(axis=1)) - bound.mean(axis=1), 0) / error)
    said = f"particle filter, {PARTICLES} particles: mean and variance against the grid, over {PATHS} paths"
    return largest_z(said, scores, PATHS - 1)


def ekf_checks(ekf: Moments, exact: Moments, own: Moments) -> list[Check]:
    """How the EKF's errors grow with kappa, and that the largest is the EKF's and not the grid's."""
    means, variances = (
        rms_over(found - truth, axis=(1, 2))[SMALL] for found, truth in zip(ekf, exact, strict=True)
    )
    sd = np.sqrt(exact.variance[-1])
    off, floor = (float(rms(part / sd)) for part in ((ekf.mean - exact.mean)[-1], own.mean[-1]))
    said = f"RMS error of the EKF's mean at κ = {CURVATURES[-1]:g}, × posterior sd"
    return [
        order("order in κ of the error of the EKF's mean", 1, list(means)),
        order("order in κ of the error of the EKF's variance", 1, list(variances)),
        at_least(said, off, floor, "the grid's own error, from halving h and dt"),
    ]


def error_panel(ekf: Moments, sampled: Moments, exact: Moments) -> Panel:
    """RMS errors over time and paths, in posterior standard deviations, over kappa."""
    lines = []
    both = (
        ("EKF", ekf, list(range(len(CURVATURES))), "line"),
        (f"{PARTICLES} particles", sampled, SAMPLED, "points"),
    )
    for name, found, at, look in both:
        kappa, mean, sd = [CURVATURES[i] for i in at], exact.mean[at], np.sqrt(exact.variance[at])
        lines.append(
            Line(
                f"{name}, mean",
                kappa,
                rms_over((found.mean - mean) / sd, axis=(1, 2)).tolist(),
                look,
            )
        )
        lines.append(
            Line(
                f"{name}, std",
                kappa,
                rms_over(np.sqrt(found.variance) / sd - 1, axis=(1, 2)).tolist(),
                look,
            )
        )
    title = "Errors against the Kushner-Stratonovich equation"
    return Panel(title, "curvature κ of the measurement", "RMS error (× posterior sd)", lines, "xy")


def path_panel(ekf: Moments, sampled: Moments, exact: Moments) -> Panel:
    """One path at the largest kappa."""
    time = np.linspace(0, 1, STEPS + 1).tolist()
    mean, sd = exact.mean[-1, 0], np.sqrt(exact.variance[-1, 0])
    lines = [
        Line(
            "grid, ± 2 std",
            time,
            mean.tolist(),
            "line",
            (mean - 2 * sd).tolist(),
            (mean + 2 * sd).tolist(),
        ),
        Line("EKF", time, ekf.mean[-1, 0].tolist(), "dashed"),
        Line("particle filter", time, sampled.mean[-1, 0].tolist(), "points"),
    ]
    return Panel(
        f"Belief mean along one path, κ = {CURVATURES[-1]:g}", "time (s)", "belief mean μ", lines
    )


def certify(seed: int = 0) -> Certificate:
    """The certificate; `seed` draws the paths and the particles."""
    curved, panels = curved_case(seed)
    tried = ", ".join(f"{CURVATURES[i]:g}" for i in SAMPLED)
    text = (
        "The Kushner-Stratonovich equation is solved on a grid by splitting, for one state. Where the measurement is"
        " linear, the package's Kalman filter and Kalman-Bucy's equations are recovered at the orders of the scheme;"
        " one step of the solver is the drift (6a) and the diffusion (6b). Where it is curved, c(x) = x + κx²/2, the"
        " particle filter has no bias that shows, while the Gaussian belief of the EKF errs by O(κ); of κ ="
        f" {tried} its mean is farther off than {PARTICLES} particles, which scatter, from {worse_from(panels[0]):g} on"
        ". The statement is checked for one state and constant noise, not for infinite dimensions as such."
    )
    checks = [*space_orders(), *time_orders(seed), channel_check(), *step_orders(), *curved]
    return Certificate("belief_dynamics", "Eqs. (5)(6), belief dynamics", text, checks, panels)
