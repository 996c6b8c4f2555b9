"""Draws kept trajectories over their scene, of one cell or of several side by side."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..cell_results import CellResults
from .lines import draw_over_time
from .plane import (
    LIGHT_GREYS,
    add_noise_bar,
    axis_labels,
    draw_scene,
    enclosing_box,
    largest_noise,
    shared_top,
    start_and_goal,
    view_box,
)
from .style import BLUE, ORANGE, SCREEN, drawing_style, wrapped_title

TRAJECTORIES_PNG = "trajectories.png"  # beside the results of a cell
WIDTH = 7.2  # inches
LOWEST = 0.25  # height of a panel over its width, at least
HIGHEST = 1.2  # height of a panel over its width, at most


class PathPanel(NamedTuple):
    """Holds what a panel shows of one cell."""

    paths: pd.DataFrame  # one row per step of a drawn trial, the position first in its state
    scene: dict[str, Any]
    collided: set[int]  # drawn trials that collided
    title: str
    failed: int = 0  # kept trials that are not drawn, since they failed


def kept_panel(cell: CellResults, title: str) -> PathPanel | None:
    """Returns the panel of the kept trials that did not fail; None where there are none."""
    paths = cell.good_paths
    if paths.empty or cell.scene is None:
        return None
    drawn_trials = set(paths["trial"])
    failed = cell.paths["trial"].nunique() - len(drawn_trials)
    return PathPanel(paths, cell.scene, cell.collided_trials & drawn_trials, title, failed)


def plane_panel(cell: CellResults, title: str) -> PathPanel | None:
    """Returns the panel of a cell's good trials; None where no paths in a plane were kept."""
    panel = kept_panel(cell, title)
    return panel if panel is not None and len(panel.scene["start"]) == 2 else None


def trajectories_figure(panel: PathPanel) -> Figure:
    """Draws true paths in the plane over sigma_o; other positions over time."""
    with drawing_style(SCREEN):
        if len(panel.scene["start"]) == 2:
            return _draw_panels([panel], columns=1)
        numbers = _numbers(panel, set())
        return draw_over_time(panel.paths, panel.scene, panel.collided, panel.title, numbers)


def compare_paths(panels: Sequence[PathPanel]) -> Figure:
    """Draws the paths of several cells in the plane, a panel each, on one scale."""
    with drawing_style(SCREEN):
        return _draw_panels(panels, columns=2)


def _draw_panels(panels: Sequence[PathPanel], columns: int) -> Figure:
    """Draws panels of paths in the plane on one scale."""
    rows = -(-len(panels) // columns)
    corners = enclosing_box([_path_box(panel) for panel in panels])
    figure = Figure(figsize=_figure_size(corners, rows, columns), layout="constrained")
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)

    # One view and one shading for all panels.
    top = shared_top(largest_noise(panel.scene, corners) for panel in panels)
    for axes, panel in zip(grid.flat, panels, strict=False):
        shading = _draw_paths(axes, panel, top)
        axes.set_title(wrapped_title(panel.title, columns))
    labels = axis_labels(panels[0].scene)
    for axes in grid[-1]:
        axes.set_xlabel(labels[0])
    for axes in grid[:, 0]:
        axes.set_ylabel(labels[1])
    grid[0, 0].set(xlim=corners[:, 0], ylim=corners[:, 1])

    bar: Any = {"fraction": 0.04, "pad": 0.02, "shrink": 0.8}
    add_noise_bar(figure, grid, shading, panels[0].scene, **bar)
    figure.legend(*_path_legend(panels, corners), loc="outside lower center", ncols=4)
    return figure


def _draw_paths(axes: Axes, panel: PathPanel, top: float | None) -> QuadMesh | None:
    """Draws one panel; returns its shading, for the colour bar."""
    for trial, steps in panel.paths.groupby("trial"):
        state = np.stack(list(steps["state"]))
        style: Any = {"color": BLUE, "alpha": 0.45, "zorder": 3}
        if trial in panel.collided:
            style = {"color": ORANGE, "alpha": 0.75, "zorder": 4}
        axes.plot(state[:, 0], state[:, 1], lw=0.8, **style)
    return draw_scene(axes, panel.scene, cmap=LIGHT_GREYS, top=top)


def _figure_size(corners: np.ndarray, rows: int, columns: int) -> tuple[float, float]:
    """Returns width and height in inches of panels with the aspect of the view (2, 2)."""
    extent = corners[1] - corners[0]
    panel_width = (WIDTH - 1.4) / columns
    panel_height = panel_width * min(max(extent[1] / extent[0], LOWEST), HIGHEST)
    return WIDTH, 1.1 + rows * (panel_height + 0.35)


def _path_box(panel: PathPanel) -> np.ndarray:
    """Returns the corners (2, 2) of the box around everything that one panel shows."""
    return view_box([_positions(panel)], panel.scene)


def _positions(panel: PathPanel) -> np.ndarray:
    """Returns the positions (n, 2) of all steps of a panel."""
    return np.stack(list(panel.paths["state"]))[:, :2].astype(float)


def _path_legend(
    panels: Sequence[PathPanel], corners: np.ndarray
) -> tuple[list[Line2D], list[str]]:
    """Returns handles and labels: numbers of paths for one panel, their meaning for several."""
    start, goal = start_and_goal()
    handles = [start, goal, Line2D([], [], color=BLUE, lw=1.5)]
    collided = Line2D([], [], color=ORANGE, lw=1.5)
    if len(panels) == 1:
        outside = _trials_outside(panels[0], corners)
        free, *others = _numbers(panels[0], outside)
        handles += [collided] if panels[0].collided else []
        handles += [Line2D([], [], ls="none") for _ in others[len(handles) - 3 :]]
        return handles, ["start", "goal", free, *others]
    labels = ["start", "goal", "a trial"]
    if any(panel.collided for panel in panels):
        handles.append(collided)
        labels.append("a trial that collides")
    notes = sorted({note for panel in panels for note in _notes(panel, corners)})
    handles += [Line2D([], [], ls="none") for _ in notes]
    return handles, [*labels, *notes]


def _notes(panel: PathPanel, corners: np.ndarray) -> list[str]:
    """Returns what one of several panels does not show, in words."""
    hidden = panel.failed + len(_trials_outside(panel, corners))
    return [f"{panel.title}: {hidden} not or not wholly drawn"] if hidden else []


def _numbers(panel: PathPanel, outside: set[int]) -> list[str]:
    """Returns the numbers of the paths that are drawn, that collide, and that cannot be seen."""
    collided = len(panel.collided)
    free = panel.paths["trial"].nunique() - collided
    texts = [f"{free} {'path' if free == 1 else 'paths'}"]
    if collided:
        texts.append(f"{collided} that {'collides' if collided == 1 else 'collide'}")
    if panel.failed:
        texts.append(f"{panel.failed} failed, not drawn")
    if outside:
        texts.append(f"{len(outside)} {'leaves' if len(outside) == 1 else 'leave'} the picture")
    return texts


def _trials_outside(panel: PathPanel, corners: np.ndarray) -> set[int]:
    """Returns the trials that leave the view with these corners (2, 2)."""
    positions = _positions(panel)
    outside = np.any((positions < corners[0]) | (positions > corners[1]), axis=1)
    return set(panel.paths["trial"][outside])
