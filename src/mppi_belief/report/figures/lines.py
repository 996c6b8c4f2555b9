"""Draws positions that do not lie in a plane over time, a panel per coordinate."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from .plane import axis_labels
from .style import BLUE, GREEN, INK, ORANGE, wrapped_title

MOST_COORDINATES = 4  # panels; further coordinates are not drawn
OBSTACLE: Any = {"facecolor": "white", "edgecolor": INK, "hatch": "////", "lw": 0.8}


def draw_over_time(
    paths: pd.DataFrame,
    scene: dict[str, Any],
    collided: set[int],
    title: str,
    numbers: Sequence[str],
) -> Figure:
    """Draws each coordinate of the position over time (s), the goal, and obstacles on a line.

    The state of `paths` has the position first. The legend names the paths as `numbers` do: those
    that are free, those in `collided` if there are any, and notes.
    """
    labels = axis_labels(scene)[:MOST_COORDINATES]
    height = 0.8 + 2.4 * len(labels) if len(labels) == 1 else 1.2 + 1.5 * len(labels)
    figure = Figure(figsize=(7.2, height), layout="constrained")
    panels = figure.subplots(len(labels), 1, sharex=True, squeeze=False)[:, 0]
    for index, (axes, label) in enumerate(zip(panels, labels, strict=True)):
        for trial, steps in paths.groupby("trial"):
            time = steps["step"] * scene["dt"]
            position = [state[index] for state in steps["state"]]
            style: Any = {"color": BLUE, "alpha": 0.45, "zorder": 3}
            if trial in collided:
                style = {"color": ORANGE, "alpha": 0.75, "zorder": 4}
            axes.plot(time, position, lw=0.8, **style)
        axes.axhline(scene["goal"][index], color=GREEN, lw=1.5, ls="--")
        axes.set_ylabel(label)

    # On a line the obstacles are bands; the view is that of the paths and the goal.
    bands = obstacle_bands(scene)
    draw_bands(panels[0], bands)
    panels[0].set_title(wrapped_title(title))
    panels[-1].set_xlabel("time (s)")
    handles: list[Any] = [Line2D([], [], color=BLUE, lw=1.5)]
    if collided:
        handles.append(Line2D([], [], color=ORANGE, lw=1.5))
    handles += [Line2D([], [], ls="none") for _ in numbers[len(handles) :]]
    handles.append(Line2D([], [], color=GREEN, lw=1.5, ls="--"))
    texts = [*numbers, "goal"]
    if bands:
        handles.append(Patch(**OBSTACLE))
        texts.append("obstacle")
    figure.legend(handles, texts, loc="outside lower center", ncols=5)
    return figure


def obstacle_bands(scene: dict[str, Any]) -> list[tuple[float, float]]:
    """Returns the ends of the obstacles on a line; none for positions of more coordinates."""
    if len(scene["start"]) != 1:
        return []
    radius = scene["radius"]
    bands = [(center[0] - radius, center[0] + radius) for center in scene["obstacles"]]
    if "clearance" in scene:
        x, level = (np.asarray(scene["clearance"][name], dtype=float) for name in ("x", "level"))
        inside = np.concatenate([[False], np.nan_to_num(level, nan=np.inf) <= 0, [False]])
        firsts = np.flatnonzero(inside[1:] & ~inside[:-1])
        lasts = np.flatnonzero(inside[:-1] & ~inside[1:]) - 1
        bands += [
            (float(x[first]), float(x[last])) for first, last in zip(firsts, lasts, strict=True)
        ]
    return bands


def draw_bands(axes: Axes, bands: Sequence[tuple[float, float]]) -> None:
    """Draws obstacles on a line as bands over all times."""
    for low, high in bands:
        axes.axhspan(low, high, zorder=1, **OBSTACLE)
