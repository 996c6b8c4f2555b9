"""The matching residual eps* of the light-dark system, at rest and along a line (Sec. VII).

    eps* = min over W >= 0 of |D - G W G'| / |D| = sqrt(1 - (k^2 / (1 + k^2))^2),   k = K_v / K_p

once the filter of the double integrator is at rest: D is made of K K', and only its velocity block
can be matched. With sigma_o an intensity, (11) gives k^2 = sigma_w / (2 sigma_o). A filter that
samples every dt with standard deviation sigma_o has, by spectral factorisation of its innovations,

    k^2 = root / (2 C dt^2),   C = (root + sqrt(root^2 + 16)) / 4,   root = sigma_w dt^1.5 / sigma_o

with C = (1 + a) / (2 sqrt(a)) for a the product of its two poles. For sigma_o = intensity /
sqrt(dt) and dt -> 0 this tends to the first form.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...belief.prior import prior
from ...belief.schedule import gain_schedule
from ...matching.constant_weight import ConstantWeight, best_constant_weight
from ...matching.weights import best_weight, residual
from ..compilation import quick_jit
from ..solvers.weight_optimality import SEARCH_GAP, residuals_of_weights
from .section_vii import (
    cost_numbers,
    light_dark_numbers,
    light_dark_problem,
    problem_numbers,
)

METHODS = {"intensity": "riccati", "sample": "filter"}  # the schedule of each convention
REST_SECONDS = 400.0  # per step of the Riccati flow until the filter is at rest
REST_STEPS = {"intensity": 2, "sample": 700}  # until the filter is at rest


class LineResiduals(NamedTuple):
    """Holds the schedule along a path and what matching leaves of it."""

    D: np.ndarray  # (T, 4, 4)
    G: np.ndarray  # (T, 4, 2)
    best: np.ndarray  # (T,), eps* of each step
    constant: ConstantWeight  # the best single W for all steps
    constant_residuals: np.ndarray  # (T,), epsilon of this W


def time_step() -> float:
    """Returns Delta t of Sec. VII, in seconds."""
    return float(problem_numbers()["dt"])


def line_steps() -> int:
    """Returns the number of steps of a trial of Sec. VII."""
    return int(problem_numbers()["steps"])


def start_position() -> tuple[float, float]:
    """Returns the prior mean of the position, in metres."""
    x, y, *_ = problem_numbers()["prior_mean"]
    return x, y


def goal_position() -> tuple[float, float]:
    """Returns the goal position, in metres."""
    x, y, *_ = cost_numbers()["goal"]
    return x, y


def light_position() -> tuple[float, float]:
    """Returns a position in the light, in metres."""
    return light_dark_numbers()["light"], 0.0


def rest_step(convention: str) -> float:
    """Returns the length in seconds of the steps in which the filter comes to rest."""
    return REST_SECONDS if convention == "intensity" else time_step()


def closed_residual(
    sigma_o: float | np.ndarray, convention: str, dt: float | None = None
) -> np.ndarray:
    """Returns eps* at rest where the noise is sigma_o, in its closed form."""
    sigma_w = light_dark_numbers()["process_noise"]
    if convention == "intensity":
        k_squared = sigma_w / (2 * np.asarray(sigma_o))
    else:
        dt = time_step() if dt is None else dt
        root = sigma_w * dt**1.5 / np.asarray(sigma_o)
        k_squared = root / (2 * pole_ratio(root) * dt**2)
    return np.sqrt(1 - (k_squared / (1 + k_squared)) ** 2)


def pole_ratio(root: np.ndarray) -> np.ndarray:
    """Returns C = (1 + a) / (2 sqrt(a)) for a the product of the filter's two poles."""
    return (root + np.sqrt(root**2 + 16)) / 4


def residuals_at_rest(sigma_o: np.ndarray, convention: str) -> np.ndarray:
    """Returns eps* (S,) of the package's schedule after a long rest in the light.

    `sigma_o` (S,) holds the noise in the light.
    """
    steps = REST_STEPS[convention]
    mean = jnp.asarray((*light_position(), 0.0, 0.0))

    def residual_after_rest(noise_floor: Array) -> Array:
        problem = light_dark_problem(
            convention, mean, _prior_std(), rest_step(convention), steps, noise_floor
        )
        controls = jnp.zeros((steps, 2))
        schedule = gain_schedule(problem, prior(problem), controls, METHODS[convention])
        D = schedule.diffusion[-1]
        G = problem.system.G(schedule.mean[-1])
        return residual(D, G, best_weight(D, G))

    return np.asarray(quick_jit(jax.vmap(residual_after_rest))(jnp.asarray(sigma_o)))


def _prior_std() -> Array:
    return jnp.array(problem_numbers()["prior_std"])


@partial(quick_jit, static_argnames=("convention", "method"))
def schedule_along(means: Array, convention: str, method: str) -> tuple[Array, Array, Array]:
    """Returns D (T, 4, 4), G (T, 4, 2) and eps* (T,) of Sec. VII's system along means (T+1, 4)."""
    steps = len(means) - 1
    problem = light_dark_problem(convention, jnp.zeros(4), _prior_std(), time_step(), steps)
    start = prior(problem)._replace(mean=means[0])
    D = gain_schedule(problem, start, jnp.zeros((steps, 2)), method, means[1:]).diffusion
    G = jax.vmap(problem.system.G)(means[:-1])
    return D, G, jax.vmap(lambda D, G: residual(D, G, best_weight(D, G)))(D, G)


def straight_line(start: tuple[float, float], goal: tuple[float, float]) -> np.ndarray:
    """Returns means (T+1, 4) of a vehicle that moves at constant velocity."""
    steps = line_steps()
    position = np.linspace(start, goal, steps + 1)
    velocity = (position[-1] - position[0]) / (steps * time_step())
    return np.hstack([position, np.tile(velocity, (steps + 1, 1))])


def line_residuals(
    convention: str, start: tuple[float, float], goal: tuple[float, float]
) -> LineResiduals:
    """Returns the schedule and its residuals along a straight line at constant velocity."""
    means = jnp.asarray(straight_line(start, goal))
    D, G, best = (
        np.asarray(part) for part in schedule_along(means, convention, METHODS[convention])
    )
    constant = best_constant_weight(D, G, SEARCH_GAP)
    constant_residuals = np.asarray(residuals_of_weights(D, G, constant.weight[None])[0])
    return LineResiduals(D, G, best, constant, constant_residuals)


def windowed_residual() -> float:
    """Returns the mean eps* () over |p_x - 5| < 0.5 m of a Riccati schedule along the line.

    The schedule takes sigma_o as a sample's deviation. Among the readings of Sec. VII this is the
    only other one that rounds to the printed 0.79.
    """
    means = straight_line(start_position(), goal_position())
    *_, best = schedule_along(jnp.asarray(means), "sample", "riccati")
    light_x, _ = light_position()
    return float(np.mean(np.asarray(best)[np.abs(means[:-1, 0] - light_x) < 0.5]))
