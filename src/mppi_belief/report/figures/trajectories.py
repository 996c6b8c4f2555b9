"""Pictures of trials, from their kept trajectories and their scene: Fig. 1."""

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
    LIGHT,
    SIDE_BY_SIDE,
    SIGMAS,
    around,
    darkest,
    draw_scene,
    ellipse,
    ends,
    kept_in_plane,
    shown_trial,
    stacked,
    window,
)
from .points import collision_rate
from .style import BLUE, COLUMN, GREEN, INK, ORANGE, SCREEN, STYLE, method_look, method_order

TRAJECTORIES_PNG = "trajectories.png"
EVERY = 6  # steps from one belief ellipse to the next
SMALL = 0.5  # marks and edges of Fig. 1 against those of the larger pictures
STRONG: Any = {
    "lw": 1.0,
    "zorder": 4.5,
    "path_effects": [withStroke(linewidth=1.8, foreground=INK)],
}


class PathPanel(NamedTuple):
    """What a picture shows of one cell: kept paths, their scene, which trials collided, a title."""

    paths: pd.DataFrame
    scene: dict[str, Any]
    collided: set[int]
    title: str


def trajectories_figure(
    paths: pd.DataFrame, scene: dict[str, Any], collided: set[int], title: str
) -> Figure:
    """True paths in the plane over sigma_o, as Fig. 1; for one-dimensional positions, over time."""
    with mpl.rc_context(SCREEN):
        if len(scene["start"]) == 2:
            return _planes([PathPanel(paths, scene, collided, title)], columns=1)
        return _over_time(paths, scene, title)


def compare_paths(runs: Sequence[PathPanel]) -> Figure:
    """Fig. 1: the paths of several runs in the plane, a panel each, on one scale."""
    with mpl.rc_context(SCREEN):
        return _planes(runs, columns=2)


def figure_1(founds: Sequence[CellResults]) -> Figure | None:
    """Fig. 1: the kept trials of each method over sigma_o (m), a panel each, those that collide set apart.

    Titles give the collision rate of all good trials. Ellipses are the beliefs (2 sigma) at every sixth step of
    one trial, the recorded one, whose path is drawn stronger. None where no cell has paths in a plane.
    """
    ordered = sorted(founds, key=lambda found: method_order(found.method))
    cells = [(found, *kept) for found in ordered if (kept := kept_in_plane(found))]
    if not cells:
        return None
    corners = around([window([stacked(paths)[0]], scene) for _, scene, paths in cells])
    columns = min(len(cells), 2)
    rows = -(-len(cells) // columns)
    (width, height), across = corners[1] - corners[0], (COLUMN - 0.35) / columns
    with mpl.rc_context(STYLE):
        size = (
            COLUMN,
            1.08 + 0.2 * (len(cells) % columns) + rows * (0.2 + across * height / width),
        )
        figure = Figure(figsize=size, layout="compressed")
        panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        top = max(darkest(scene, corners) for _, scene, _ in cells)
        for axes, (found, scene, paths) in zip(panels.flat, cells, strict=False):
            _method_panel(axes, found, paths)
            shading = draw_scene(axes, scene, size=SMALL, cmap=LIGHT, top=top)
        _finish(figure, panels, len(cells), corners)
        figure.colorbar(
            shading,
            ax=panels,
            label=r"$\sigma_o$ (m)",
            location="bottom",
            aspect=40,
            fraction=0.05,
            pad=0.01,
        )
        _explain(figure, [found.method for found, _, _ in cells])
        return figure


def _method_panel(axes: Axes, found: CellResults, paths: pd.DataFrame) -> None:
    collided = set(found.good["trial"][found.collided])
    colour, chosen = method_look(found.method).colour, shown_trial(found, paths)
    for trial, steps in paths.groupby("trial"):
        position, mean, cov = stacked(steps)
        hit, strong = trial in collided, trial == chosen
        style: Any = (
            STRONG if strong else {"lw": 0.5, "alpha": 0.7 if hit else 0.45, "zorder": 3 + hit}
        )
        axes.plot(*position.T, color=ORANGE if hit else colour, **style)
        if strong:
            for k in range(0, len(mean), EVERY):
                if np.all(np.isfinite(cov[k])):
                    axes.add_patch(ellipse(mean[k], cov[k], fill=False, ec=INK, lw=0.5, zorder=4.6))
    axes.set_title(f"{found.name}, {collision_rate(found).value:.1f} % collide")


def _finish(figure: Figure, panels: np.ndarray, used: int, corners: np.ndarray) -> None:
    """Labels at the outer panels, one scale."""
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


def _explain(figure: Figure, methods: Sequence[str]) -> None:
    paths = tuple(
        Line2D([], [], color=method_look(method).colour) for method in dict.fromkeys(methods)
    )
    hit = Line2D([], [], color=ORANGE)
    belief = Line2D([], [], marker="o", mfc="none", mec=INK, mew=0.5, ms=6, ls="none")
    labels = [
        "start",
        "goal",
        "a trial",
        "a trial that collides",
        rf"belief of one trial (${SIGMAS:.0f}\sigma$)",
    ]
    handles: Any = [*ends(SMALL), paths, hit, belief]
    figure.legend(
        handles,
        labels,
        handler_map=SIDE_BY_SIDE,
        loc="outside lower center",
        ncols=3,
    )


def _planes(runs: Sequence[PathPanel], columns: int) -> Figure:
    rows = -(-len(runs) // columns)
    figure = Figure(figsize=(7.2, 5.2 if columns == 1 else 0.5 + 2.7 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes in panels.flat[len(runs) :]:
        axes.set_visible(False)
    for axes, run in zip(panels.flat, runs, strict=False):
        shading = _plane(axes, run)
    for axes in panels[-1]:
        axes.set_xlabel("$p_x$ (m)")
    for axes in panels[:, 0]:
        axes.set_ylabel("$p_y$ (m)")
    figure.colorbar(
        shading, ax=panels, label=r"$\sigma_o$ (m)", fraction=0.04, pad=0.02, shrink=0.8
    )
    figure.legend(*_legend(runs), loc="outside lower center", ncols=5)
    low, high = around([_corners(run) for run in runs]) + np.array([[-0.5], [0.5]])
    panels[0, 0].set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return figure


def _plane(axes: Axes, run: PathPanel) -> QuadMesh:
    """One panel; returns the noise shading for its colour bar."""
    for trial, group in run.paths.groupby("trial"):
        state = np.stack(list(group["state"]))
        hit = trial in run.collided
        colour, order = (ORANGE, 4) if hit else (BLUE, 3)
        axes.plot(
            state[:, 0],
            state[:, 1],
            color=colour,
            lw=0.8,
            alpha=0.75 if hit else 0.45,
            zorder=order,
        )
    axes.set_title(run.title)
    return draw_scene(axes, run.scene)


def _corners(run: PathPanel) -> np.ndarray:
    """The box around everything one panel shows (2, 2)."""
    states = np.stack(list(run.paths["state"]))[:, :2]
    everything = np.vstack([states, *run.scene["obstacles"], run.scene["goal"]])
    return np.stack([everything.min(axis=0), everything.max(axis=0)])


def _legend(runs: Sequence[PathPanel]) -> tuple[list[Line2D], list[str]]:
    start, goal = ends()
    path, hit = Line2D([], [], color=BLUE, lw=1.5), Line2D([], [], color=ORANGE, lw=1.5)
    if len(runs) > 1:
        some = any(run.collided for run in runs)
        return [start, goal, path, *[hit] * some], [
            "start",
            "goal",
            "a trial",
            *["a trial that collides"] * some,
        ]
    collided = len(runs[0].collided)
    others = f"{runs[0].paths['trial'].nunique() - collided} paths"
    handles, labels = [start, goal, path], ["start", "goal", others]
    return (
        ([*handles, hit], [*labels, f"{collided} that collide"]) if collided else (handles, labels)
    )


def _over_time(paths: pd.DataFrame, scene: dict[str, Any], title: str) -> Figure:
    figure = Figure(figsize=(7.2, 3.2), layout="constrained")
    axes = figure.subplots()
    for index, (_, group) in enumerate(paths.groupby("trial")):
        position = [state[0] for state in group["state"]]
        axes.plot(
            group["step"] * scene["dt"],
            position,
            color=BLUE,
            lw=0.8,
            alpha=0.45,
            label="paths" if not index else None,
        )
    axes.axhline(scene["goal"][0], color=GREEN, lw=1.5, ls="--", label="goal")
    axes.set(xlabel="time (s)", ylabel="position", title=title)
    figure.legend(loc="outside lower center", ncols=5)
    return figure
