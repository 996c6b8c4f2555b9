"""Describes the scene of a cell's trials: what a picture of them needs to know."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..belief.prior import prior_mixture
from ..obstacles import Obstacles
from ..problem import Problem

MARGIN = 5.0  # m, of the noise map around start, goal and obstacles
MAP_COLUMNS = 91  # grid points of the noise map along the first axis
MAP_ROWS = 31  # grid points along the second axis


def describe_scene(problem: Problem) -> dict[str, Any]:
    """Returns the scene in plain numbers.

    Its keys are dt (s), position (components of the state), start, goal and obstacles (m), radius
    (m); `starts` for a prior with modes; and `noise` for positions in the plane, which is sigma_o
    on a grid. Obstacles other than discs are left out.
    """
    start = np.asarray(problem.position_of(jnp.asarray(problem.prior_mean)))
    goal = np.asarray(problem.position_of(jnp.asarray(problem.cost.goal)))
    centers = np.zeros((0, len(start)))
    radius = 0.0
    if isinstance(problem.obstacles, Obstacles):
        centers = np.asarray(problem.obstacles.centers)
        radius = float(problem.obstacles.radius)
    scene: dict[str, Any] = {
        "dt": float(problem.dt),
        "position": _components(problem),
        "start": start.tolist(),
        "goal": goal.tolist(),
        "obstacles": centers.tolist(),
        "radius": radius,
    }
    if problem.prior_modes is not None:
        starts = jax.vmap(problem.position_of)(prior_mixture(problem).means)
        scene["starts"] = np.round(np.asarray(starts, dtype=float), 6).tolist()
    if len(start) == 2:
        scene["noise"] = _noise_map(problem, np.vstack([start, goal, *centers]))
    return scene


def _components(problem: Problem) -> list[int]:
    """Returns the components of the state that are the position, also if they are all."""
    nx = len(problem.prior_mean)
    return list(range(nx) if problem.position is None else problem.position)


def _noise_map(problem: Problem, points: np.ndarray) -> dict[str, Any]:
    """Returns the root mean square of sigma_o over a grid around points (P, 2).

    Other components of the state are those of the prior's mean. The level has the shape
    (MAP_ROWS, MAP_COLUMNS).
    """
    low = points.min(axis=0) - MARGIN
    high = points.max(axis=0) + MARGIN
    x = np.linspace(low[0], high[0], MAP_COLUMNS)
    y = np.linspace(low[1], high[1], MAP_ROWS)
    state = jnp.asarray(problem.prior_mean)
    first, second = _components(problem)

    def level(px: jax.Array, py: jax.Array) -> jax.Array:
        factor = problem.system.sigma_o(state.at[first].set(px).at[second].set(py))
        return jnp.sqrt(jnp.mean(jnp.sum(factor**2, axis=1)))

    row = jax.vmap(level, in_axes=(0, None))
    levels = jax.vmap(row, in_axes=(None, 0))(jnp.asarray(x), jnp.asarray(y))
    return {
        "x": x.tolist(),
        "y": y.tolist(),
        "level": np.round(np.asarray(levels, dtype=float), 4).tolist(),
    }
