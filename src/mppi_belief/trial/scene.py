"""What a picture of the trials needs to know of the world they ran in."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..belief.prior import prior_mixture
from ..problem import Problem


def describe_scene(problem: Problem) -> dict[str, Any]:
    """dt, start (and `starts`, of a prior with modes), goal, obstacles and, in the plane, sigma_o on a grid."""
    system = problem.system
    start = np.asarray(system.position(jnp.asarray(problem.prior_mean)))
    goal = np.asarray(system.position(jnp.asarray(problem.cost.goal)))
    obstacles = getattr(system, "obstacles", None)
    centers = np.asarray(obstacles.centers) if obstacles is not None else np.zeros((0, len(start)))
    scene: dict[str, Any] = {
        "dt": float(problem.dt),
        "start": start.tolist(),
        "goal": goal.tolist(),
    }
    scene |= {
        "obstacles": centers.tolist(),
        "radius": float(obstacles.radius) if obstacles is not None else 0.0,
    }
    if problem.prior_modes is not None:
        places = jax.vmap(system.position)(prior_mixture(problem).means)
        scene["starts"] = np.round(np.asarray(places, dtype=float), 6).tolist()
    if len(start) == 2:
        scene["noise"] = _noise_map(problem, np.vstack([start, goal, *centers]))
    return scene


def _noise_map(problem: Problem, points: np.ndarray) -> dict[str, Any]:
    """Root mean square of the measurement noise's standard deviations over a grid around the points."""
    low, high = points.min(axis=0) - 5, points.max(axis=0) + 5
    x, y = np.linspace(low[0], high[0], 91), np.linspace(low[1], high[1], 31)
    base = jnp.asarray(problem.prior_mean)

    def level(px: jax.Array, py: jax.Array) -> jax.Array:
        factor = problem.system.sigma_o(base.at[0].set(px).at[1].set(py))
        return jnp.sqrt(jnp.mean(jnp.sum(factor**2, axis=1)))

    grid = jax.vmap(jax.vmap(level, in_axes=(0, None)), in_axes=(None, 0))(
        jnp.asarray(x), jnp.asarray(y)
    )
    return {
        "x": x.tolist(),
        "y": y.tolist(),
        "level": np.round(np.asarray(grid, dtype=float), 4).tolist(),
    }
