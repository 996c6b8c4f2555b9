"""What every picture of the plane shares: sigma_o as shading, obstacles, start, goal, ellipses of beliefs."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import Colormap, LinearSegmentedColormap
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Ellipse

from ..cell_results import CellResults
from .style import GREEN, INK

SIGMAS = 2.0  # how far belief ellipses reach
LIGHT = LinearSegmentedColormap.from_list(
    "light", ["#FFFFFF", "#8C8C8C"]
)  # thin lines stay visible on its dark end

SIDE_BY_SIDE: Any = {
    tuple: HandlerTuple(ndivide=None, pad=0.2)
}  # a legend entry for several methods


def draw_scene(
    axes: Axes,
    scene: dict[str, Any],
    *,
    size: float = 1.0,
    cmap: str | Colormap = "Greys",
    top: float | None = None,
) -> QuadMesh:
    """Shading from 0 to `top` metres, obstacles, start and goal; the shading, for its colour bar."""
    noise, edge = (
        scene["noise"],
        {"facecolor": "white", "edgecolor": INK, "lw": 1.2 * size, "hatch": "////"},
    )
    for center in scene["obstacles"]:
        axes.add_patch(Circle(center, scene["radius"], zorder=2, **edge))
    for marker in ends(size):
        points = (
            scene.get("starts", [scene["start"]]) if marker.get_marker() == "o" else [scene["goal"]]
        )
        marker.set_data([point[0] for point in points], [point[1] for point in points])
        axes.add_line(marker)
    axes.set_aspect("equal")
    levels = np.asarray(noise["level"])
    return axes.pcolormesh(
        noise["x"], noise["y"], levels, cmap=cmap, vmin=0, vmax=top, shading="gouraud", zorder=0
    )


def ends(size: float = 1.0) -> list[Line2D]:
    """The marks of start and goal."""
    start = Line2D(
        [], [], marker="o", color="white", mec=INK, mew=size, ms=7 * size, ls="none", zorder=5
    )
    return [
        start,
        Line2D(
            [], [], marker="*", color=GREEN, mec=INK, mew=size, ms=13 * size, ls="none", zorder=5
        ),
    ]


def ellipse(mean: np.ndarray, cov: np.ndarray, **look: Any) -> Ellipse:
    """Where `SIGMAS` standard deviations of a belief's position reach; mean (n,) and cov (n, n), positions first."""
    size, angle = spread(cov)
    return Ellipse(
        (float(mean[0]), float(mean[1])), float(size[0]), float(size[1]), angle=angle, **look
    )


def spread(cov: np.ndarray) -> tuple[np.ndarray, float]:
    """Width and height (2,) of that ellipse, in metres, and the angle of its width, in degrees."""
    values, vectors = np.linalg.eigh(cov[:2, :2])
    size = 2 * SIGMAS * np.sqrt(np.maximum(values[::-1], 0))
    return size, float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))


def reach(mean: np.ndarray, cov: np.ndarray) -> list[np.ndarray]:
    """The lower and upper corners (T, 2) of the boxes around those ellipses; mean (T, n), cov (T, n, n)."""
    far = SIGMAS * np.sqrt(np.diagonal(cov, axis1=1, axis2=2)[:, :2])
    return [mean[:, :2] - far, mean[:, :2] + far]


def window(paths: Iterable[np.ndarray], scene: dict[str, Any]) -> np.ndarray:
    """The corners (2, 2) of a box around paths (T, 2) and scene, no larger than what is shaded, in metres."""
    around = scene["radius"] * np.array([[-1, -1], [1, 1]])
    obstacles = [np.asarray(center) + around for center in scene["obstacles"]]
    points = np.vstack([*paths, *obstacles, scene["start"], scene["goal"]])
    x, y = scene["noise"]["x"], scene["noise"]["y"]
    low, high = np.nanmin(points, axis=0) - 0.35, np.nanmax(points, axis=0) + 0.35
    return np.stack([np.maximum(low, [x[0], y[0]]), np.minimum(high, [x[-1], y[-1]])])


def around(boxes: Sequence[np.ndarray]) -> np.ndarray:
    """The corners (2, 2) of the box around boxes given by theirs."""
    corners = np.stack(boxes)
    return np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])


def darkest(scene: dict[str, Any], corners: np.ndarray) -> float:
    """The greatest sigma_o on the grid within the corners, in metres."""
    x, y, level = (np.asarray(scene["noise"][name]) for name in ("x", "y", "level"))
    inside = np.ix_(
        (y >= corners[0, 1]) & (y <= corners[1, 1]), (x >= corners[0, 0]) & (x <= corners[1, 0])
    )
    return float(level[inside].max() if level[inside].size else level.max())


def kept_in_plane(found: CellResults) -> tuple[dict[str, Any], pd.DataFrame] | None:
    """The scene of a cell and the paths of its good trials, None where there are none or positions are no plane."""
    paths = found.paths[found.paths["trial"].isin(found.good["trial"])]
    return (
        None
        if paths.empty or found.scene is None or "noise" not in found.scene
        else (found.scene, paths)
    )


def shown_trial(found: CellResults, paths: pd.DataFrame) -> int:
    """The trial that pictures single out: the recorded one, else 0, else the first of those whose paths are there."""
    kept = set(paths["trial"])
    wishes = [found.recording["trial"]] if found.recording else []
    return next((trial for trial in [*wishes, 0] if trial in kept), min(kept))


def stacked(steps: pd.DataFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions (T + 1, 2), belief means (T + 1, n) and covariances (T + 1, n, n) of one trial's steps."""
    state, mean, cov = (
        np.stack(list(steps[name])).astype(float) for name in ("state", "mean", "cov")
    )
    return state[:, :2], mean, cov.reshape(len(mean), mean.shape[1], mean.shape[1])
