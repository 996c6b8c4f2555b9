"""Draws Fig. 1: the kept trials of each method over sigma_o, and the belief along one of them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from ..cell_results import CellResults
from .plane import (
    ELLIPSE_EVERY,
    ELLIPSE_SIGMAS,
    LIGHT_GREYS,
    SIDE_BY_SIDE,
    add_noise_bar,
    axis_labels,
    belief_ellipse,
    draw_scene,
    enclosing_box,
    has_obstacles,
    kept_in_plane,
    largest_noise,
    shared_top,
    shown_trial,
    stacked_steps,
    start_and_goal,
    view_box,
)
from .points import collision_rate
from .style import COLUMN, INK, ORANGE, STYLE, drawing_style, method_look, method_order

FIGURE_1_SIZE = 0.5  # marks and edges of Fig. 1, relative to those of the larger pictures
STRONG_PATH: Any = {
    "lw": 1.0,
    "zorder": 4.5,
    "path_effects": [withStroke(linewidth=1.8, foreground=INK)],
}


def figure_1(cells: Sequence[CellResults]) -> Figure | None:
    """Draws Fig. 1: the kept trials of each method over sigma_o, with collisions set apart.

    Among obstacles titles give the collision rate of all good trials. Ellipses are the beliefs (2
    sigma) at every sixth step of one trial, the recorded one, whose path is drawn stronger. None
    where no cell has paths in a plane.
    """
    ordered = sorted(cells, key=lambda cell: method_order(cell.method))
    shown = [
        (cell, scene_and_paths)
        for cell in ordered
        if (scene_and_paths := kept_in_plane(cell)) is not None
    ]
    if not shown:
        return None
    boxes = [view_box([stacked_steps(paths)[0]], scene) for _, (scene, paths) in shown]
    corners = enclosing_box(boxes)
    top = shared_top(largest_noise(scene, corners) for _, (scene, _) in shown)

    # The size: panels of equal scale, as wide as the column allows.
    columns = min(len(shown), 2)
    rows = -(-len(shown) // columns)
    width, height = corners[1] - corners[0]
    panel_height = 0.2 + (COLUMN - 0.35) / columns * height / width
    size = (COLUMN, 1.08 + 0.2 * (len(shown) % columns) + rows * panel_height)

    with drawing_style(STYLE):
        figure = Figure(figsize=size, layout="compressed")
        panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for axes, (cell, (scene, paths)) in zip(panels.flat, shown, strict=False):
            _draw_method_panel(axes, cell, scene, paths)
            shading = draw_scene(axes, scene, size=FIGURE_1_SIZE, cmap=LIGHT_GREYS, top=top)
        scene = shown[0][1][0]
        _label_panels(panels, len(shown), corners, axis_labels(scene))
        bar: Any = {"location": "bottom", "aspect": 40, "fraction": 0.05, "pad": 0.01}
        add_noise_bar(figure, panels, shading, scene, **bar)
        any_collides = any(cell.collided_trials & set(paths["trial"]) for cell, (_, paths) in shown)
        _add_figure_1_legend(figure, [cell.method for cell, _ in shown], any_collides)
        return figure


def _draw_method_panel(
    axes: Axes, cell: CellResults, scene: dict[str, Any], paths: pd.DataFrame
) -> None:
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
    rate = f", {collision_rate(cell).value:.1f} % collide" if has_obstacles(scene) else ""
    axes.set_title(f"{cell.name}{rate}")


def _add_belief_ellipses(axes: Axes, mean: np.ndarray, cov: np.ndarray) -> None:
    """Draws the beliefs of one trial, mean (T + 1, n) and cov (T + 1, n, n), at some steps."""
    for k in range(0, len(mean), ELLIPSE_EVERY):
        if np.all(np.isfinite(cov[k])):
            ellipse = belief_ellipse(mean[k], cov[k], fill=False, ec=INK, lw=0.5, zorder=4.6)
            axes.add_patch(ellipse)


def _label_panels(
    panels: np.ndarray, used: int, corners: np.ndarray, labels: Sequence[str]
) -> None:
    """Labels the outer panels, hides the unused ones and sets one scale."""
    for axes in panels.flat[used:]:
        axes.set_visible(False)
    for axes in panels.flat[max(used - panels.shape[1], 0) : used]:
        axes.tick_params(labelbottom=True)
        axes.set_xlabel(labels[0])
    for axes in panels[:, 0]:
        axes.set_ylabel(labels[1])
    panels[0, 0].set(xlim=corners[:, 0], ylim=corners[:, 1])
    for axis in (panels[0, 0].xaxis, panels[0, 0].yaxis):
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))


def _add_figure_1_legend(figure: Figure, methods: Sequence[str], any_collides: bool) -> None:
    """Adds the legend below the panels; it speaks of collisions where one is drawn."""
    colours = [method_look(method).colour for method in dict.fromkeys(methods)]
    paths = tuple(Line2D([], [], color=colour) for colour in colours)
    collided = Line2D([], [], color=ORANGE)
    belief = Line2D([], [], marker="o", mfc="none", mec=INK, mew=0.5, ms=6, ls="none")
    labels = ["start", "goal", "a trial"]
    handles: Any = [*start_and_goal(FIGURE_1_SIZE), paths]
    if any_collides:
        labels.append("a trial that collides")
        handles.append(collided)
    labels.append(rf"belief of one trial (${ELLIPSE_SIGMAS:.0f}\sigma$)")
    handles.append(belief)
    style: Any = {"handler_map": SIDE_BY_SIDE, "loc": "outside lower center", "ncols": 3}
    figure.legend(handles, labels, **style)
