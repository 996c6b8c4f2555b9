"""Describes the scene of a cell's trials: what a picture of them needs to know.

Only pictures read a scene. A part of it that cannot be computed is left out and named with the
reason, and the trials stand.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..belief.prior import prior_mixture
from ..errors import first_line
from ..obstacles import Obstacles
from ..problem import Problem

MARGIN_STDS = 3.0  # prior standard deviations around start, goal and obstacles, beside their span
NOISE_COLUMNS = 91  # grid points of the noise map along the first axis
NOISE_ROWS = 31  # grid points along the second axis
CLEARANCE_POINTS = 241  # grid points of the clearance along each axis
DIGITS = 5  # significant digits of the largest value of a map

Box = tuple[np.ndarray, np.ndarray]  # the lower and the upper corner, (d,) each


def describe_scene(problem: Problem) -> dict[str, Any]:
    """Returns the scene in plain numbers and texts.

    Its keys are

    - dt (s), position (components of the state), labels (d, of the axes), start and goal (d,)
    - starts (modes, d), for a prior with modes
    - obstacles (n, d) and radius, which are the discs of `Obstacles`
    - clearance, for positions in the plane and on a line among obstacles of any other shape, which
      is `problem.obstacles.clearance` on a grid
    - noise, for positions in the plane, which is sigma_o on a grid, see `_noise_map`
    - left_out, which says by part why it is absent
    """
    left_out: dict[str, str] = {}

    def optional(part: str, describe: Callable[[], Any]) -> Any:
        try:
            return describe()
        except Exception as error:  # of a user's own system or obstacles, away from the trials
            left_out[part] = f"{type(error).__name__}: {first_line(error)}"
            return None

    start = np.asarray(problem.position_of(jnp.asarray(problem.prior_mean)), dtype=float)
    goal = np.asarray(problem.position_of(jnp.asarray(problem.cost.goal)), dtype=float)
    centers, radius = _discs(problem, len(start))
    box = _shown_box(problem, np.vstack([start, goal, *centers]))
    scene: dict[str, Any] = {
        "dt": float(problem.dt),
        "position": _components(problem),
        "labels": optional("labels", lambda: _position_labels(problem)),
        "start": start.tolist(),
        "goal": goal.tolist(),
        "obstacles": centers.tolist(),
        "radius": radius,
    }
    if problem.prior_modes is not None:
        starts = jax.vmap(problem.position_of)(prior_mixture(problem).means)
        scene["starts"] = np.round(np.asarray(starts, dtype=float), 6).tolist()
    if len(start) <= 2 and problem.obstacles is not None and not _is_discs(problem):
        scene["clearance"] = optional("obstacles", lambda: _clearance_map(problem, box))
    if len(start) == 2:
        scene["noise"] = optional("sigma_o", lambda: _noise_map(problem, box))
    described = {name: part for name, part in scene.items() if part is not None}
    return described | ({"left_out": left_out} if left_out else {})


def _is_discs(problem: Problem) -> bool:
    """Says whether the obstacles are discs, which are drawn exactly."""
    return type(problem.obstacles) is Obstacles


def _discs(problem: Problem, d: int) -> tuple[np.ndarray, float]:
    """Returns centres (n, d) and radius of obstacles that are discs; none of any others."""
    if isinstance(problem.obstacles, Obstacles) and _is_discs(problem):
        centers = np.asarray(problem.obstacles.centers, dtype=float)
        return centers.reshape(-1, d), float(problem.obstacles.radius)
    return np.zeros((0, d)), 0.0


def _components(problem: Problem) -> list[int]:
    """Returns the components of the state that are the position, also if they are all."""
    return problem.surroundings.position_components(len(problem.prior_mean))


def _position_labels(problem: Problem) -> list[str] | None:
    """Returns the labels (d,) that the system gives its position; None if it gives none.

    Raises `ValueError` for labels that are not one per component of the state.
    """
    labels = getattr(problem.system, "state_labels", None)
    if labels is None:
        return None
    nx = len(problem.prior_mean)
    if len(labels) != nx:
        raise ValueError(f"state_labels has {len(labels)} labels for a state of {nx}")
    return [str(labels[component]) for component in _components(problem)]


def _shown_box(problem: Problem, points: np.ndarray) -> Box:
    """Returns the corners of the maps: points (P, d) with room for trials that stray from them.

    The room is the largest extent of the points and `MARGIN_STDS` deviations of the prior.
    """
    low = points.min(axis=0)
    high = points.max(axis=0)
    stds = np.asarray(problem.prior_std, dtype=float)[_components(problem)]
    margin = np.max(high - low) + MARGIN_STDS * np.max(stds)
    margin = margin if margin > 0 else 1.0
    return low - margin, high + margin


def _clearance_map(problem: Problem, box: Box) -> dict[str, Any]:
    """Returns the distance to the nearest obstacle over a grid of positions; inside below zero.

    The level has the shape (points of y, points of x), or (points of x,) on a line.
    """
    obstacles: Any = problem.obstacles
    axes = [np.linspace(*ends, CLEARANCE_POINTS) for ends in zip(*box, strict=True)]
    grid = np.stack(np.meshgrid(*axes), axis=-1)
    positions = jnp.asarray(grid.reshape(-1, len(axes)), dtype=float)
    level = np.asarray(jax.vmap(obstacles.clearance)(positions), dtype=float)
    names = ("x", "y")[: len(axes)]
    coordinates = {name: axis.tolist() for name, axis in zip(names, axes, strict=True)}
    return coordinates | {"level": _rounded_map(level.reshape(grid.shape[:-1]))}


def _noise_map(problem: Problem, box: Box) -> dict[str, Any]:
    """Returns sigma_o over a grid of positions, with its unit.

    The level (NOISE_ROWS, NOISE_COLUMNS) is the root mean square over the measurements in the unit
    of the first one; `partial` says that there are others. The unit is absent where the system does
    not name it. Other components of the state are those of the prior's mean.
    """
    low, high = box
    x = np.linspace(low[0], high[0], NOISE_COLUMNS)
    y = np.linspace(low[1], high[1], NOISE_ROWS)
    state = jnp.asarray(problem.prior_mean, dtype=float)
    first, second = _components(problem)
    units = getattr(problem.system, "measurement_units", None)
    ny = problem.system.sigma_o(state).shape[0]
    if units is not None and len(units) != ny:
        raise ValueError(f"measurement_units has {len(units)} units for {ny} measurements")
    rows = [i for i in range(ny) if units is None or units[i] == units[0]]

    def level(px: Array, py: Array) -> Array:
        factor = problem.system.sigma_o(state.at[first].set(px).at[second].set(py))
        return jnp.sqrt(jnp.mean(jnp.sum(factor[jnp.asarray(rows)] ** 2, axis=1)))

    row = jax.vmap(level, in_axes=(0, None))
    levels = jax.vmap(row, in_axes=(None, 0))(jnp.asarray(x), jnp.asarray(y))
    noise = {"x": x.tolist(), "y": y.tolist(), "level": _rounded_map(np.asarray(levels, float))}
    if units is None:
        return noise
    per_sample = problem.noise_convention == "sample"
    unit = str(units[0]) if per_sample else rf"{units[0]} $\sqrt{{\mathrm{{s}}}}$".strip()
    return noise | {"unit": unit, "partial": len(rows) < ny}


def _rounded_map(level: np.ndarray) -> Any:
    """Returns a map as lists, rounded to `DIGITS` significant digits of its largest value."""
    largest = np.max(np.abs(level), where=np.isfinite(level), initial=0.0)
    decimals = DIGITS - 1 - int(np.floor(np.log10(largest))) if largest > 0 else 0
    return np.round(level, decimals).tolist()
