"""What a picture of the trials needs to know of the world they ran in."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..belief.prior import prior_mixture
from ..obstacles import Obstacles
from ..problem import Problem


def describe_scene(problem: Problem) -> dict[str, Any]:
    """dt, start (and `starts`, of a prior with modes), goal, obstacles and, in the plane, sigma_o on a grid."""
    start = np.asarray(problem.position_of(jnp.asarray(problem.prior_mean)))
    goal = np.asarray(problem.position_of(jnp.asarray(problem.cost.goal)))
    centers = np.zeros((0, len(start)))
    radius = 0.0
    if isinstance(problem.obstacles, Obstacles):
        centers = np.asarray(problem.obstacles.centers)
        radius = float(problem.obstacles.radius)
    scene: dict[str, Any] = {
        "dt": float(problem.dt),
        "position": problem.surroundings.position_first(len(problem.prior_mean))[: len(start)],
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


def _noise_map(problem: Problem, points: np.ndarray) -> dict[str, Any]:
    """Root mean square of the measurement noise's standard deviations over a grid around the points."""
    low, high = points.min(axis=0) - 5, points.max(axis=0) + 5
    x, y = np.linspace(low[0], high[0], 91), np.linspace(low[1], high[1], 31)
    base = jnp.asarray(problem.prior_mean)
    first, second = problem.surroundings.position_first(len(base))[:2]

    def level(px: jax.Array, py: jax.Array) -> jax.Array:
        factor = problem.system.sigma_o(base.at[first].set(px).at[second].set(py))
        return jnp.sqrt(jnp.mean(jnp.sum(factor**2, axis=1)))

    grid = jax.vmap(jax.vmap(level, in_axes=(0, None)), in_axes=(None, 0))(
        jnp.asarray(x), jnp.asarray(y)
    )
    return {
        "x": x.tolist(),
        "y": y.tolist(),
        "level": np.round(np.asarray(grid, dtype=float), 4).tolist(),
    }
