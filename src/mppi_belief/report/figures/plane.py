"""Draws what pictures of the plane share: sigma_o, obstacles, start, goal, belief ellipses."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import Colormap, LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Ellipse

from ..cell_results import CellResults
from .style import GREEN, INK

ELLIPSE_SIGMAS = 2.0  # standard deviations, the half-axes of belief ellipses
ELLIPSE_EVERY = 6  # steps from one belief ellipse to the next
VIEW_MARGIN = 0.05  # of the extent of everything that a picture shows, on each side
FILL_FROM = -1e30  # below every clearance

# Light enough that thin lines stay visible on its dark end.
LIGHT_GREYS = LinearSegmentedColormap.from_list("light", ["#FFFFFF", "#8C8C8C"])

# A legend entry that shows several methods side by side.
SIDE_BY_SIDE: Any = {tuple: HandlerTuple(ndivide=None, pad=0.2)}


def axis_labels(scene: dict[str, Any]) -> list[str]:
    """Returns the labels (d,) of the position: those of the system, or x and y."""
    d = len(scene["start"])
    default = ["x", "y"] if d <= 2 else [f"$x_{i + 1}$" for i in range(d)]
    return list(scene.get("labels") or default[:d])


def noise_label(scene: dict[str, Any]) -> str:
    """Returns the label of the shading by sigma_o, with its unit where the system names it."""
    unit = scene["noise"].get("unit")
    if unit is None:
        return r"$\sigma_o$"
    if scene["noise"].get("partial"):
        return rf"$\sigma_o$ of measurements in {unit}"
    return rf"$\sigma_o$ ({unit})" if unit else r"$\sigma_o$"


def has_obstacles(scene: dict[str, Any]) -> bool:
    """Returns whether there are obstacles, of any shape."""
    return bool(scene["obstacles"]) or "clearance" in scene


def draw_scene(
    axes: Axes,
    scene: dict[str, Any],
    *,
    size: float = 1.0,
    cmap: str | Colormap = "Greys",
    top: float | None = None,
) -> QuadMesh | None:
    """Draws sigma_o as shading from 0 to `top`, the obstacles, start and goal.

    `size` scales marks and edges. Returns the shading, for its colour bar; None where sigma_o is
    not known.
    """
    draw_obstacles(axes, scene, size)
    start, goal = start_and_goal(size)
    for marker, points in (
        (start, scene.get("starts", [scene["start"]])),
        (goal, [scene["goal"]]),
    ):
        marker.set_data([point[0] for point in points], [point[1] for point in points])
        axes.add_line(marker)

    axes.set_aspect("equal")
    if "noise" not in scene:
        return None
    noise = scene["noise"]
    levels = np.ma.masked_invalid(np.asarray(noise["level"], dtype=float))
    shading: Any = "nearest" if np.ma.is_masked(levels) else "gouraud"
    return axes.pcolormesh(
        noise["x"], noise["y"], levels, cmap=cmap, vmin=0, vmax=top, shading=shading, zorder=0
    )


def draw_obstacles(axes: Axes, scene: dict[str, Any], size: float = 1.0) -> None:
    """Draws discs exactly, and obstacles of any other shape where their clearance is below zero."""
    edge = {"facecolor": "white", "edgecolor": INK, "lw": 1.2 * size, "hatch": "////"}
    for center in scene["obstacles"]:
        axes.add_patch(Circle(center, scene["radius"], zorder=2, **edge))
    if "clearance" in scene:
        x, y, level = (np.asarray(scene["clearance"][name]) for name in ("x", "y", "level"))
        level = np.nan_to_num(level, nan=np.inf)
        if level.min() < 0:
            inside: Any = {"colors": ["white"], "hatches": ["////"], "zorder": 2}
            axes.contourf(x, y, level, levels=[FILL_FROM, 0.0], **inside)
            outline: Any = {"colors": [INK], "linewidths": 1.2 * size, "zorder": 2}
            axes.contour(x, y, level, levels=[0.0], **outline)


def add_noise_bar(
    figure: Figure, axes: Any, shading: QuadMesh | None, scene: dict[str, Any], **style: Any
) -> None:
    """Adds the colour bar of sigma_o beside some axes, unless there is no shading."""
    if shading is not None:
        figure.colorbar(shading, ax=axes, label=noise_label(scene), **style)


def start_and_goal(size: float = 1.0) -> list[Line2D]:
    """Returns the marks of start and goal."""
    style: Any = {"mec": INK, "mew": size, "ls": "none", "zorder": 5}
    start = Line2D([], [], marker="o", color="white", ms=7 * size, **style)
    goal = Line2D([], [], marker="*", color=GREEN, ms=13 * size, **style)
    return [start, goal]


def belief_ellipse(mean: np.ndarray, cov: np.ndarray, **style: Any) -> Ellipse:
    """Returns the `ELLIPSE_SIGMAS` ellipse of a belief's position.

    The first two of mean (n,) and cov (n, n) are the position.
    """
    size, angle = ellipse_shape(cov)
    center = (float(mean[0]), float(mean[1]))
    return Ellipse(center, float(size[0]), float(size[1]), angle=angle, **style)


def ellipse_shape(cov: np.ndarray) -> tuple[np.ndarray, float]:
    """Returns width and height (2,) of a belief ellipse in m, and its width's angle in degrees."""
    values, vectors = np.linalg.eigh(cov[:2, :2])
    size = 2 * ELLIPSE_SIGMAS * np.sqrt(np.maximum(values[::-1], 0))
    return size, float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))


def ellipse_boxes(mean: np.ndarray, cov: np.ndarray) -> list[np.ndarray]:
    """Returns the corners, 2 x (T, 2), of the boxes around ellipses; mean (T, n), cov (T, n, n)."""
    reach = ELLIPSE_SIGMAS * np.sqrt(np.diagonal(cov, axis1=1, axis2=2)[:, :2])
    return [mean[:, :2] - reach, mean[:, :2] + reach]


def view_box(paths: Iterable[np.ndarray], scene: dict[str, Any]) -> np.ndarray:
    """Returns the corners (2, 2) of the box around paths (T, 2) and scene.

    The box is no larger than the maps of sigma_o and the clearance, so that no part of a picture
    looks as if the sensor were perfect there.
    """
    corners = scene["radius"] * np.array([[-1, -1], [1, 1]])
    obstacles = [np.asarray(center) + corners for center in scene["obstacles"]]
    starts = scene.get("starts", [scene["start"]])
    points = np.vstack([*paths, *obstacles, *starts, scene["goal"], *_inside_points(scene)])
    low = np.nanmin(points, axis=0)
    high = np.nanmax(points, axis=0)
    margin = VIEW_MARGIN * np.max(high - low)
    box = np.stack([low - margin, high + margin])
    for name in ("noise", "clearance"):
        if name in scene:
            ends = [(scene[name][axis][0], scene[name][axis][-1]) for axis in ("x", "y")]
            box = np.clip(box, *np.transpose(ends))
    return box


def _inside_points(scene: dict[str, Any]) -> list[np.ndarray]:
    """Returns the grid points (n, 2) in obstacles of any shape that are wholly on the map.

    A wall that reaches the edge of the map does not widen a picture.
    """
    if "clearance" not in scene:
        return []
    x, y, level = (np.asarray(scene["clearance"][name]) for name in ("x", "y", "level"))
    inside = level < 0
    at_edge = inside[0].any() or inside[-1].any() or inside[:, 0].any() or inside[:, -1].any()
    if at_edge or not inside.any():
        return []
    rows, columns = np.nonzero(inside)
    return [np.stack([x[columns], y[rows]], axis=1)]


def enclosing_box(boxes: Sequence[np.ndarray]) -> np.ndarray:
    """Returns the corners (2, 2) of the box around boxes that are given by theirs."""
    corners = np.stack(boxes)
    return np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])


def largest_noise(scene: dict[str, Any], corners: np.ndarray) -> float | None:
    """Returns the largest finite sigma_o on the grid points within the corners (2, 2).

    None where there is none.
    """
    if "noise" not in scene:
        return None
    x, y, level = (np.asarray(scene["noise"][name], dtype=float) for name in ("x", "y", "level"))
    in_x = (x >= corners[0, 0]) & (x <= corners[1, 0])
    in_y = (y >= corners[0, 1]) & (y <= corners[1, 1])
    inside = level[np.ix_(in_y, in_x)]
    shown = inside if inside.size else level
    finite = shown[np.isfinite(shown)]
    return float(finite.max()) if finite.size else None


def shared_top(tops: Iterable[float | None]) -> float | None:
    """Returns the largest of some ends of a shading; None where no end is known."""
    return max((top for top in tops if top is not None), default=None)


def kept_in_plane(cell: CellResults) -> tuple[dict[str, Any], pd.DataFrame] | None:
    """Returns the scene of a cell and the paths of its good trials.

    None where no paths were kept or positions do not lie in a plane.
    """
    paths = cell.good_paths
    if paths.empty or cell.scene is None or len(cell.scene["start"]) != 2:
        return None
    return cell.scene, paths


def shown_trial(cell: CellResults, paths: pd.DataFrame) -> int:
    """Returns the trial that pictures single out among those whose paths are given.

    This is the recorded trial if it is among them, else trial 0, else the first.
    """
    trials = set(paths["trial"])
    preferred = [cell.recording["trial"]] if cell.recording else []
    return next((trial for trial in [*preferred, 0] if trial in trials), min(trials))


def stacked_steps(steps: pd.DataFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns positions (T + 1, 2), means (T + 1, n) and covariances (T + 1, n, n) of one trial."""
    state, mean, cov = (
        np.stack(list(steps[name])).astype(float) for name in ("state", "mean", "cov")
    )
    n = mean.shape[1]
    return state[:, :2], mean, cov.reshape(len(mean), n, n)
