"""Beyond the paper: Feynman-Kac where every path carries its own covariance (`controller=belief_joint`).

    dmu = (f + G u) dt + L dW,  L L' = lambda G R^-1 G',    dSigma = Ric(Sigma, mu) dt          (8a) matched, (11)
    -dV/dt = min_u q + 1/2 R u^2 + (f + G u) V_mu + Ric V_Sigma + 1/2 lambda G R^-1 G' V_mumu

The belief (mu, Sigma) is a diffusion whose second part has no noise of its own: V_Sigma enters once, to first order, so
V = -lambda log Psi still makes the equation linear, and Psi is the expectation of exp(-S / lambda) over paths of
mu along which Sigma is carried. Here: one state, a sensor that is good in one place.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.polynomial.hermite_e import hermegauss
from scipy.interpolate import RectBivariateSpline

from ...belief.cost import expected_terminal, risk_sensitive
from ...belief.gaussian import RootBelief
from ...costs import GoalObstacleCost
from ...obstacles import Obstacles
from ...planning import path_integral as pi
from ...planning.path_costs import RiskSensitive
from ...planning.schedules import PerPathCovariance
from ...problem import Problem
from ...results.certificate import Certificate, Check, Line, Panel
from ...structs import number, struct
from ..bands import at_least, order, quantile, within_errors
from ..compilation import quick_jit
from ..estimates import rms

DURATION, THETA, TEMPERATURE = 0.8, 0.5, 0.6
LEVELS = (4, 8, 16, 32)  # steps
PATHS = 1 << 16
STARTS = ((-0.6, 0.7), (0.4, 0.6))  # mean and standard deviation
MEANS, VARIANCES = np.linspace(-4.5, 4.5, 91), np.geomspace(0.01, 1.6, 36)
INSIDE = slice(35, 61), slice(18, 33)  # of these, where the equation is looked at
NODES = 16
TEXT = (
    "The desirability that the package samples, each path with the covariance that its own filter would have, is "
    "compared with a backward recursion over mean and variance by quadrature and splines, and so is the control; the "
    "recursion's V is put into the nonlinear equation in (μ, Σ), whose residual vanishes with Δt at first order. What "
    "the shared covariance of Assumption 1 would give instead lies far outside the error. The statement concerns the "
    "sampled diffusion λ G R⁻¹ G'; that the measurements move the mean by D(μ, Σ) remains the paper's approximation."
)


@struct
class Lit:
    """dx = u dt + sigma_w dw,  dy = x dt + (floor + slope (x - light)^2) dnu."""

    process_noise: float = number(ge=0)
    floor: float = number(gt=0)
    slope: float = number(ge=0)
    light: float = number()

    @property
    def H(self) -> Array:
        return jnp.reshape(jnp.asarray(self.process_noise, dtype=float), (1, 1))

    def f(self, x: Array) -> Array:
        return jnp.zeros_like(x)

    def G(self, x: Array) -> Array:
        return jnp.ones((1, 1))

    def c(self, x: Array) -> Array:
        return x

    def sigma_o(self, x: Array) -> Array:
        return jnp.reshape(self.floor + self.slope * (x[0] - self.light) ** 2, (1, 1))


class Sampled(NamedTuple):
    """Psi and the first control from paths, with standard errors; V with the covariance shared, less V."""

    psi: float
    psi_error: float
    control: float
    control_error: float
    shared: float


LIT = Lit(0.4, 0.5, 0.4, 1.5)


def problem_of(steps: int) -> Problem:
    """The scalar problem in so many steps."""
    one = jnp.ones(1)
    cost = GoalObstacleCost(0 * one, one, 2 * one, one, w_obs=1.5, bump_width=0.5)
    return Problem(
        LIT,
        cost,
        0 * one,
        one,
        DURATION / steps,
        steps,
        obstacles=Obstacles(0.8 * jnp.ones((1, 1)), 0),
        noise_convention="intensity",
    )


def certify(seed: int = 0) -> Certificate:
    """Psi and control at two beliefs, the residual of the equation at many."""
    levels = [recursion(problem_of(steps)) for steps in LEVELS]
    residuals = [residual(problem_of(len(level)), level) for level in levels]
    checks = [
        order(
            "equation in (μ, Σ): RMS residual of the recursion's V, order in Δt",
            1,
            [rms(r) for r in residuals],
        )
    ]
    problem = problem_of(LEVELS[1])
    for start, key in zip(STARTS, jax.random.split(jax.random.key(seed), len(STARTS)), strict=True):
        checks += _at(problem, levels[1], start, key)
    return Certificate(
        "joint_covariance",
        "Corollary 5 with a covariance for every path",
        TEXT,
        checks,
        [_panel(levels[-1])],
    )


def _at(
    problem: Problem, values: list[RectBivariateSpline], start: tuple[float, float], key: Array
) -> list[Check]:
    mean, std = start
    log_psi, control = exact(problem, values, np.array([mean]), np.array([std**2]))
    found = sampled(problem, mean, std, key)
    where = f"at μ = {mean:g}, standard deviation {std:g}"
    freeze = quantile() * TEMPERATURE * found.psi_error / found.psi
    return [
        within_errors(
            f"(17) {where} over the recursion's",
            found.psi / np.exp(log_psi[0]),
            1.0,
            found.psi_error / np.exp(log_psi[0]),
        ),
        within_errors(
            f"(19) {where}: the first control", found.control, control[0], found.control_error
        ),
        at_least(
            f"V {where}, were the covariance shared: how far off",
            abs(found.shared),
            freeze,
            "what sampling could explain",
        ),
    ]


def recursion(problem: Problem) -> list[RectBivariateSpline]:
    """log Psi over (mu, log Sigma) at steps 1..H of the discrete problem, costs at the end of steps."""
    mu, variance = np.meshgrid(MEANS, VARIANCES, indexing="ij")
    terminal = quick_jit(jax.vmap(lambda m, s: expected_terminal(problem, m[None], s[None, None])))
    log_psi = -np.asarray(terminal(mu.ravel(), variance.ravel())) / TEMPERATURE
    values = [_spline(log_psi)]
    for _ in range(problem.steps - 1):
        values.insert(0, _spline(exact(problem, values, mu.ravel(), variance.ravel())[0]))
    return values


def _spline(values: np.ndarray) -> RectBivariateSpline:
    return RectBivariateSpline(
        MEANS, np.log(VARIANCES), values.reshape(len(MEANS), len(VARIANCES)), kx=5, ky=5
    )


def exact(
    problem: Problem, values: list[RectBivariateSpline], mean: np.ndarray, variance: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """log Psi and the control (n,) one step before `values[0]`, by Gauss-Hermite quadrature over that step."""
    nodes, weights = hermegauss(NODES)
    increments = nodes * np.sqrt(TEMPERATURE / problem.dt)  # covariance lambda R^-1 / dt, R = 1
    mu, after = filtered(
        LIT, mean[:, None] + increments * problem.dt, variance[:, None], problem.dt
    )
    rate = running(problem, mu.ravel(), after.ravel()).reshape(mu.shape)
    log = (
        values[0].ev(mu.ravel(), np.log(after.ravel())).reshape(mu.shape)
        - rate * problem.dt / TEMPERATURE
    )
    most = log.max(axis=1, keepdims=True)
    w = np.exp(log - most) * weights / np.sqrt(2 * np.pi)
    return most[:, 0] + np.log(w.sum(axis=1)), w @ increments / w.sum(axis=1)


def filtered(
    system: Lit, mean: np.ndarray, variance: np.ndarray, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance after a step that led the mean there: the scalar Kalman filter, written out."""
    ahead = variance + system.process_noise**2 * dt
    noise = sensor(system, mean) / dt
    return mean, ahead * noise / (ahead + noise)


def sensor(system: Lit, mean: np.ndarray) -> np.ndarray:
    """R_o."""
    return (system.floor + system.slope * (mean - system.light) ** 2) ** 2


def running(problem: Problem, mean: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """q_RS (n,)."""
    return np.asarray(_running(problem, jnp.asarray(mean), jnp.asarray(variance)))


@quick_jit
def _running(problem: Problem, mean: Array, variance: Array) -> Array:
    return jax.vmap(lambda m, s: risk_sensitive(problem, m[None], s[None, None], THETA))(
        mean, variance
    )


def residual(problem: Problem, values: list[RectBivariateSpline]) -> np.ndarray:
    """What is left of the equation at the first step of V = -lambda log Psi, at beliefs in the middle."""
    mu, variance = (grid[INSIDE] for grid in np.meshgrid(MEANS, VARIANCES, indexing="ij"))
    at, after = (-TEMPERATURE * v.ev(mu, np.log(variance)) for v in values[:2])
    slope, bend = (-TEMPERATURE * values[0].ev(mu, np.log(variance), dx=k) for k in (1, 2))
    in_variance = -TEMPERATURE * values[0].ev(mu, np.log(variance), dy=1) / variance
    riccati = LIT.process_noise**2 - variance**2 / sensor(LIT, mu)
    rate = running(problem, mu.ravel(), variance.ravel()).reshape(mu.shape)
    left = rate - 0.5 * slope**2 + riccati * in_variance + 0.5 * TEMPERATURE * bend
    return (after - at) / problem.dt + left


def sampled(problem: Problem, mean: float, std: float, key: Array) -> Sampled:
    """From the package's own paths."""
    increments, costs, shared = (
        np.asarray(a) for a in _paths(problem, jnp.array([mean]), jnp.array([[std]]), key)
    )
    w = np.exp(-costs / TEMPERATURE)
    psi, first = w.mean(), increments
    control = (w @ first) / w.sum()
    error = np.sqrt(np.mean((w * (first - control)) ** 2) / len(w)) / psi
    other = np.mean(np.exp(-shared / TEMPERATURE))
    return Sampled(
        psi, w.std(ddof=1) / np.sqrt(len(w)), control, error, TEMPERATURE * np.log(psi / other)
    )


@quick_jit
def _paths(problem: Problem, mean: Array, root: Array, key: Array) -> tuple[Array, Array, Array]:
    """First increments, costs with a covariance for each path, costs with that of the still path for all; each (N,)."""
    start = RootBelief(mean, root)
    plan = PerPathCovariance().plan(
        problem, RiskSensitive(THETA), start, jnp.zeros((problem.steps, 1))
    )
    normals = pi.normals(key, (problem.steps, 1, PATHS), False)
    increments = pi.matched_increments(problem, normals, TEMPERATURE, None)
    costs, means = plan.costs(increments, None)
    shared = pi.accumulated_costs(
        problem, mean, means, plan.cov, True,
        lambda mu, cov: risk_sensitive(problem, mu, cov, THETA),
        lambda mu, cov: expected_terminal(problem, mu, cov),
    )  # fmt: skip
    return increments[0, 0], costs, shared


def _panel(values: list[RectBivariateSpline]) -> Panel:
    means = np.linspace(-2, 2.5, 91)
    lines = [
        Line(
            f"standard deviation {std:g}",
            means.tolist(),
            (-TEMPERATURE * values[0].ev(means, np.full(91, 2 * np.log(std)))).tolist(),
        )
        for std in (0.3, 0.6, 0.9)
    ]
    return Panel(
        "Value of a belief, the light at 1.5",
        "belief mean μ (dimensionless)",
        "V (dimensionless)",
        lines,
    )
