"""Draws kept trajectories over their scene: Fig. 1, one cell, and cells side by side."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MultipleLocator

from ..cell_results import CellResults
from .plane import (
    ELLIPSE_SIGMAS,
    LIGHT_GREYS,
    SIDE_BY_SIDE,
    belief_ellipse,
    draw_scene,
    enclosing_box,
    kept_in_plane,
    largest_noise,
    shown_trial,
    stacked_steps,
    start_and_goal,
    view_box,
)
from .points import collision_rate
from .style import BLUE, COLUMN, GREEN, INK, ORANGE, SCREEN, STYLE, method_look, method_order

TRAJECTORIES_PNG = "trajectories.png"  # beside the results of a cell
ELLIPSE_EVERY = 6  # steps from one belief ellipse to the next
FIGURE_1_SIZE = 0.5  # marks and edges of Fig. 1, relative to those of the larger pictures
STRONG_PATH: Any = {
    "lw": 1.0,
    "zorder": 4.5,
    "path_effects": [withStroke(linewidth=1.8, foreground=INK)],
}


class PathPanel(NamedTuple):
    """Holds what a panel shows of one cell."""

    paths: pd.DataFrame  # one row per step of a kept trial
    scene: dict[str, Any]
    collided: set[int]  # trials that collided
    title: str


def cell_panel(cell: CellResults, title: str) -> PathPanel | None:
    """Returns the panel of a cell's good trials; None where no paths in a plane were kept."""
    kept = kept_in_plane(cell)
    if kept is None:
        return None
    scene, paths = kept
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


def figure_1(cells: Sequence[CellResults]) -> Figure | None:
    """Draws Fig. 1: the kept trials of each method over sigma_o (m), with collisions set apart.

    Titles give the collision rate of all good trials. Ellipses are the beliefs (2 sigma) at every
    sixth step of one trial, the recorded one, whose path is drawn stronger. None where no cell has
    paths in a plane.
    """
    ordered = sorted(cells, key=lambda cell: method_order(cell.method))
    shown = [(cell, kept) for cell in ordered if (kept := kept_in_plane(cell)) is not None]
    if not shown:
        return None
    boxes = [view_box([stacked_steps(paths)[0]], scene) for _, (scene, paths) in shown]
    corners = enclosing_box(boxes)
    top = max(largest_noise(scene, corners) for _, (scene, _) in shown)

    # The size: panels of equal scale, as wide as the column allows.
    columns = min(len(shown), 2)
    rows = -(-len(shown) // columns)
    width, height = corners[1] - corners[0]
    panel_height = 0.2 + (COLUMN - 0.35) / columns * height / width
    size = (COLUMN, 1.08 + 0.2 * (len(shown) % columns) + rows * panel_height)

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=size, layout="compressed")
        panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for axes, (cell, (scene, paths)) in zip(panels.flat, shown, strict=False):
            _draw_method_panel(axes, cell, paths)
            shading = draw_scene(axes, scene, size=FIGURE_1_SIZE, cmap=LIGHT_GREYS, top=top)
        _label_panels(panels, len(shown), corners)
        bar: Any = {"location": "bottom", "aspect": 40, "fraction": 0.05, "pad": 0.01}
        figure.colorbar(shading, ax=panels, label=r"$\sigma_o$ (m)", **bar)
        _add_figure_1_legend(figure, [cell.method for cell, _ in shown])
        return figure


def _draw_method_panel(axes: Axes, cell: CellResults, paths: pd.DataFrame) -> None:
    """Draws the paths of one method, and the belief along the trial that is singled out."""
    colour = method_look(cell.method).colour
    singled_out = shown_trial(cell, paths)
    collided_trials = cell.collided_trials
    for trial, steps in paths.groupby("trial"):
        position, mean, cov = stacked_steps(steps)
        collided = trial in collided_trials
        style: Any = {"lw": 0.5, "alpha": 0.7 if collided else 0.45, "zorder": 3 + collided}
        if trial == singled_out:
            style = STRONG_PATH
        axes.plot(*position.T, color=ORANGE if collided else colour, **style)
        if trial == singled_out:
            _add_belief_ellipses(axes, mean, cov)
    axes.set_title(f"{cell.name}, {collision_rate(cell).value:.1f} % collide")


def _add_belief_ellipses(axes: Axes, mean: np.ndarray, cov: np.ndarray) -> None:
    """Draws the beliefs of one trial, mean (T + 1, n) and cov (T + 1, n, n), at some steps."""
    for k in range(0, len(mean), ELLIPSE_EVERY):
        if np.all(np.isfinite(cov[k])):
            ellipse = belief_ellipse(mean[k], cov[k], fill=False, ec=INK, lw=0.5, zorder=4.6)
            axes.add_patch(ellipse)


def _label_panels(panels: np.ndarray, used: int, corners: np.ndarray) -> None:
    """Labels the outer panels, hides the unused ones and sets one scale."""
    for axes in panels.flat[used:]:
        axes.set_visible(False)
    for axes in panels.flat[max(used - panels.shape[1], 0) : used]:
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("$p_x$ (m)")
    for axes in panels[:, 0]:
        axes.set_ylabel("$p_y$ (m)")
    panels[0, 0].set(xlim=corners[:, 0], ylim=corners[:, 1])
    for axis in (panels[0, 0].xaxis, panels[0, 0].yaxis):
        axis.set_major_locator(MultipleLocator(2))


def _add_figure_1_legend(figure: Figure, methods: Sequence[str]) -> None:
    colours = [method_look(method).colour for method in dict.fromkeys(methods)]
    paths = tuple(Line2D([], [], color=colour) for colour in colours)
    collided = Line2D([], [], color=ORANGE)
    belief = Line2D([], [], marker="o", mfc="none", mec=INK, mew=0.5, ms=6, ls="none")
    labels = [
        "start",
        "goal",
        "a trial",
        "a trial that collides",
        rf"belief of one trial (${ELLIPSE_SIGMAS:.0f}\sigma$)",
    ]
    handles: Any = [*start_and_goal(FIGURE_1_SIZE), paths, collided, belief]
    style: Any = {"handler_map": SIDE_BY_SIDE, "loc": "outside lower center", "ncols": 3}
    figure.legend(handles, labels, **style)


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
