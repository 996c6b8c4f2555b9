"""A line with a sensor that is good in one place; every path carries its own covariance.

    dmu    = (f + G u) dt + L dW,  L L' = lambda G R^-1 G'                    (8a) matched
    dSigma = Ric(Sigma, mu) dt                                               (11)
    -dV/dt = min_u q + 1/2 R u^2 + (f + G u) V_mu + Ric V_Sigma + 1/2 lambda G R^-1 G' V_mumu

The belief (mu, Sigma) is a diffusion whose second part has no noise of its own: V_Sigma enters
once, to first order, so V = -lambda log Psi still makes the equation linear, and Psi is the
expectation of exp(-S / lambda) over paths of mu along which Sigma is propagated. A backward
recursion over (mu, log Sigma) computes Psi and the control by quadrature and splines.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.polynomial.hermite_e import hermegauss
from scipy.interpolate import RectBivariateSpline

from ...belief.cost import expected_terminal, risk_sensitive
from ...costs import GoalObstacleCost
from ...costs.penalties import Bump
from ...obstacles import Obstacles
from ...problem import Problem
from ...structs import number, struct
from ..compilation import quick_jit

LIT_DURATION = 0.8
LIT_THETA = 0.5
LIT_TEMPERATURE = 0.6
LIT_MEANS = np.linspace(-4.5, 4.5, 91)
LIT_VARIANCES = np.geomspace(0.01, 1.6, 36)
# Of LIT_MEANS x LIT_VARIANCES, where the equation is examined.
INSIDE = (slice(35, 61), slice(18, 33))
LIT_NODES = 16  # of the Gauss-Hermite rule


@struct
class LitLine:
    """Implements dx = u dt + sigma_w dw, dy = x dt + (floor + slope (x - light)^2) dnu."""

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


LIT_LINE = LitLine(0.4, 0.5, 0.4, 1.5)
LogPsi = list[RectBivariateSpline]  # log Psi over (mu, log Sigma) at steps 1..H


def lit_problem(steps: int) -> Problem:
    """Returns the scalar problem in `steps` steps."""
    unit = jnp.ones(1)
    cost = GoalObstacleCost(0 * unit, unit, 2 * unit, unit, w_obs=1.5, obstacle_penalty=Bump(0.5))
    return Problem(
        LIT_LINE,
        cost,
        prior_mean=0 * unit,
        prior_std=unit,
        dt=LIT_DURATION / steps,
        steps=steps,
        obstacles=Obstacles(0.8 * jnp.ones((1, 1)), 0),
        noise_convention="intensity",
    )


def backward_recursion(problem: Problem) -> LogPsi:
    """Returns log Psi of the discrete problem, costs being charged at the end of each step."""
    mu, variance = np.meshgrid(LIT_MEANS, LIT_VARIANCES, indexing="ij")
    terminal = quick_jit(jax.vmap(lambda m, s: expected_terminal(problem, m[None], s[None, None])))
    log_psi = -np.asarray(terminal(mu.ravel(), variance.ravel())) / LIT_TEMPERATURE
    values = [_spline(log_psi)]
    for _ in range(problem.steps - 1):
        values.insert(0, _spline(exact_step(problem, values, mu.ravel(), variance.ravel())[0]))
    return values


def _spline(values: np.ndarray) -> RectBivariateSpline:
    shaped = values.reshape(len(LIT_MEANS), len(LIT_VARIANCES))
    return RectBivariateSpline(LIT_MEANS, np.log(LIT_VARIANCES), shaped, kx=5, ky=5)


def exact_step(
    problem: Problem, values: LogPsi, mean: np.ndarray, variance: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns log Psi and the control (n,) one step before `values[0]`.

    The expectation over that step is a Gauss-Hermite sum.
    """
    nodes, weights = hermegauss(LIT_NODES)
    increments = nodes * np.sqrt(LIT_TEMPERATURE / problem.dt)  # covariance lambda R^-1 / dt, R = 1
    mu = mean[:, None] + increments * problem.dt
    filtered_variance = kalman_variance(LIT_LINE, mu, variance[:, None], problem.dt)
    rate = running_risk(problem, mu.ravel(), filtered_variance.ravel()).reshape(mu.shape)
    next_log_psi = values[0].ev(mu.ravel(), np.log(filtered_variance.ravel())).reshape(mu.shape)
    log_terms = next_log_psi - rate * problem.dt / LIT_TEMPERATURE
    largest = log_terms.max(axis=1, keepdims=True)
    w = np.exp(log_terms - largest) * weights / np.sqrt(2 * np.pi)
    return largest[:, 0] + np.log(w.sum(axis=1)), w @ increments / w.sum(axis=1)


def kalman_variance(
    system: LitLine, mean: np.ndarray, variance: np.ndarray, dt: float
) -> np.ndarray:
    """Returns the variance after a step that led to `mean`: the scalar Kalman filter by hand."""
    predicted = variance + system.process_noise**2 * dt
    noise = sensor_noise(system, mean) / dt
    return predicted * noise / (predicted + noise)


def sensor_noise(system: LitLine, mean: np.ndarray) -> np.ndarray:
    """Returns R_o at means of any shape."""
    return (system.floor + system.slope * (mean - system.light) ** 2) ** 2


def running_risk(problem: Problem, mean: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Returns q_RS (n,) at means and variances (n,)."""
    return np.asarray(_running_risk(problem, jnp.asarray(mean), jnp.asarray(variance)))


@quick_jit
def _running_risk(problem: Problem, mean: Array, variance: Array) -> Array:
    return jax.vmap(lambda m, s: risk_sensitive(problem, m[None], s[None, None], LIT_THETA))(
        mean, variance
    )


def joint_bellman_residual(problem: Problem, values: LogPsi) -> np.ndarray:
    """Returns what V = -lambda log Psi leaves of the equation at the first step.

    It is examined at the beliefs `INSIDE`.
    """
    mu, variance = (grid[INSIDE] for grid in np.meshgrid(LIT_MEANS, LIT_VARIANCES, indexing="ij"))
    log_variance = np.log(variance)
    V, V_next = (-LIT_TEMPERATURE * spline.ev(mu, log_variance) for spline in values[:2])
    gradient, hessian = (
        -LIT_TEMPERATURE * values[0].ev(mu, log_variance, dx=order) for order in (1, 2)
    )
    V_Sigma = -LIT_TEMPERATURE * values[0].ev(mu, log_variance, dy=1) / variance
    riccati = LIT_LINE.process_noise**2 - variance**2 / sensor_noise(LIT_LINE, mu)
    rate = running_risk(problem, mu.ravel(), variance.ravel()).reshape(mu.shape)
    right_side = rate - 0.5 * gradient**2 + riccati * V_Sigma + 0.5 * LIT_TEMPERATURE * hessian
    return (V_next - V) / problem.dt + right_side
