"""Draws kept trajectories over their scene, of one cell or of several side by side."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..cell_results import CellResults
from .plane import (
    draw_scene,
    enclosing_box,
    kept_in_plane,
    start_and_goal,
)
from .style import BLUE, GREEN, ORANGE, SCREEN

TRAJECTORIES_PNG = "trajectories.png"  # beside the results of a cell


class PathPanel(NamedTuple):
    """Holds what a panel shows of one cell."""

    paths: pd.DataFrame  # one row per step of a kept trial
    scene: dict[str, Any]
    collided: set[int]  # trials that collided
    title: str


def cell_panel(cell: CellResults, title: str) -> PathPanel | None:
    """Returns the panel of a cell's good trials; None where no paths in a plane were kept."""
    scene_and_paths = kept_in_plane(cell)
    if scene_and_paths is None:
        return None
    scene, paths = scene_and_paths
    return PathPanel(paths, scene, cell.collided_trials, title)


def trajectories_figure(panel: PathPanel) -> Figure:
    """Draws true paths in the plane over sigma_o; one-dimensional positions over time."""
    with mpl.rc_context(SCREEN):
        if len(panel.scene["start"]) == 2:
            return _draw_panels([panel], columns=1)
        return _draw_over_time(panel)


def compare_paths(panels: Sequence[PathPanel]) -> Figure:
    """Draws the paths of several cells in the plane, a panel each, on one scale."""
    with mpl.rc_context(SCREEN):
        return _draw_panels(panels, columns=2)


def _draw_panels(panels: Sequence[PathPanel], columns: int) -> Figure:
    """Draws panels of paths in the plane on one scale."""
    rows = -(-len(panels) // columns)
    height = 5.2 if columns == 1 else 0.5 + 2.7 * rows
    figure = Figure(figsize=(7.2, height), layout="constrained")
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    for axes, panel in zip(grid.flat, panels, strict=False):
        shading = _draw_paths(axes, panel)
    for axes in grid[-1]:
        axes.set_xlabel("$p_x$ (m)")
    for axes in grid[:, 0]:
        axes.set_ylabel("$p_y$ (m)")
    bar: Any = {"fraction": 0.04, "pad": 0.02, "shrink": 0.8}
    figure.colorbar(shading, ax=grid, label=r"$\sigma_o$ (m)", **bar)
    figure.legend(*_path_legend(panels), loc="outside lower center", ncols=5)
    corners = enclosing_box([_path_box(panel) for panel in panels])
    low, high = corners + np.array([[-0.5], [0.5]])
    grid[0, 0].set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return figure


def _draw_paths(axes: Axes, panel: PathPanel) -> QuadMesh:
    """Draws one panel; returns its shading, for the colour bar."""
    for trial, steps in panel.paths.groupby("trial"):
        state = np.stack(list(steps["state"]))
        style: Any = {"color": BLUE, "alpha": 0.45, "zorder": 3}
        if trial in panel.collided:
            style = {"color": ORANGE, "alpha": 0.75, "zorder": 4}
        axes.plot(state[:, 0], state[:, 1], lw=0.8, **style)
    axes.set_title(panel.title)
    return draw_scene(axes, panel.scene)


def _path_box(panel: PathPanel) -> np.ndarray:
    """Returns the corners (2, 2) of the box around everything that one panel shows."""
    states = np.stack(list(panel.paths["state"]))[:, :2]
    points = np.vstack([states, *panel.scene["obstacles"], panel.scene["goal"]])
    return np.stack([points.min(axis=0), points.max(axis=0)])


def _path_legend(panels: Sequence[PathPanel]) -> tuple[list[Line2D], list[str]]:
    """Returns handles and labels: numbers of paths for one panel, their meaning for several."""
    start, goal = start_and_goal()
    handles = [start, goal, Line2D([], [], color=BLUE, lw=1.5)]
    if len(panels) > 1:
        labels = ["start", "goal", "a trial"]
        collided_label = "a trial that collides"
    else:
        collided = len(panels[0].collided)
        others = panels[0].paths["trial"].nunique() - collided
        labels = ["start", "goal", f"{others} paths"]
        collided_label = f"{collided} that collide"
    if any(panel.collided for panel in panels):
        handles.append(Line2D([], [], color=ORANGE, lw=1.5))
        labels.append(collided_label)
    return handles, labels


def _draw_over_time(panel: PathPanel) -> Figure:
    """Draws one-dimensional positions over time (s), and the goal."""
    figure = Figure(figsize=(7.2, 3.2), layout="constrained")
    axes = figure.subplots()
    for index, (_, steps) in enumerate(panel.paths.groupby("trial")):
        time = steps["step"] * panel.scene["dt"]
        position = [state[0] for state in steps["state"]]
        label = "paths" if index == 0 else None
        axes.plot(time, position, color=BLUE, lw=0.8, alpha=0.45, label=label)
    axes.axhline(panel.scene["goal"][0], color=GREEN, lw=1.5, ls="--", label="goal")
    axes.set(xlabel="time (s)", ylabel="position", title=panel.title)
    figure.legend(loc="outside lower center", ncols=5)
    return figure
