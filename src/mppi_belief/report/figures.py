"""Pictures of trials, from their kept trajectories and their scene."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

BLUE, ORANGE, GREEN, INK = "#0072B2", "#D55E00", "#009E73", "#222222"  # Okabe and Ito: safe for colour blindness
NAME = "trajectories.png"
STYLE: Any = {"font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False}


class Run(NamedTuple):
    """What a picture shows of one cell: kept paths, their scene, which trials collided, a title."""

    paths: pd.DataFrame
    scene: dict[str, Any]
    collided: set[int]
    title: str


def trajectories(paths: pd.DataFrame, scene: dict[str, Any], collided: set[int], title: str) -> Figure:
    """True paths in the plane over sigma_o, as Fig. 1; for one-dimensional positions, over time."""
    with mpl.rc_context(STYLE):
        if len(scene["start"]) == 2:
            return _planes([Run(paths, scene, collided, title)], columns=1)
        return _over_time(paths, scene, title)


def compare(runs: Sequence[Run]) -> Figure:
    """Fig. 1: the paths of several runs in the plane, a panel each, on one scale."""
    with mpl.rc_context(STYLE):
        return _planes(runs, columns=2)


def _planes(runs: Sequence[Run], columns: int) -> Figure:
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
    figure.colorbar(shading, ax=panels, label=r"$\sigma_o$ (m)", fraction=0.04, pad=0.02, shrink=0.8)
    figure.legend(*_legend(runs), loc="outside lower center", ncols=5)
    corners = np.vstack([_corners(run) for run in runs])
    low, high = corners.min(axis=0) - 0.5, corners.max(axis=0) + 0.5
    panels[0, 0].set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return figure


def _plane(axes: Axes, run: Run) -> QuadMesh:
    """One panel; returns the noise shading for its colour bar."""
    for trial, group in run.paths.groupby("trial"):
        state = np.stack(list(group["state"]))
        hit = trial in run.collided
        colour, order = (ORANGE, 4) if hit else (BLUE, 3)
        axes.plot(state[:, 0], state[:, 1], color=colour, lw=0.8, alpha=0.75 if hit else 0.45, zorder=order)
    noise, edge = run.scene["noise"], {"facecolor": "white", "edgecolor": INK, "lw": 1.2, "hatch": "////", "zorder": 2}
    for center in run.scene["obstacles"]:
        axes.add_patch(Circle(center, run.scene["radius"], **edge))
    axes.plot(*run.scene["start"], "o", color="white", mec=INK, ms=7, zorder=5)
    axes.plot(*run.scene["goal"], "*", color=GREEN, mec=INK, ms=13, zorder=5)
    axes.set_aspect("equal")
    axes.set_title(run.title)
    levels = np.asarray(noise["level"])
    return axes.pcolormesh(noise["x"], noise["y"], levels, cmap="Greys", vmin=0, shading="gouraud", zorder=0)


def _corners(run: Run) -> np.ndarray:
    """The box around everything one panel shows (2, 2)."""
    states = np.stack(list(run.paths["state"]))[:, :2]
    everything = np.vstack([states, *run.scene["obstacles"], run.scene["goal"]])
    return np.stack([everything.min(axis=0), everything.max(axis=0)])


def _legend(runs: Sequence[Run]) -> tuple[list[Line2D], list[str]]:
    start = Line2D([], [], marker="o", color="white", mec=INK, ms=7, ls="none")
    goal = Line2D([], [], marker="*", color=GREEN, mec=INK, ms=13, ls="none")
    path, hit = Line2D([], [], color=BLUE, lw=1.5), Line2D([], [], color=ORANGE, lw=1.5)
    if len(runs) > 1:
        return [start, goal, path, hit], ["start", "goal", "a trial", "a trial that collides"]
    collided = len(runs[0].collided)
    others = f"{runs[0].paths['trial'].nunique() - collided} paths"
    handles, labels = [start, goal, path], ["start", "goal", others]
    return ([*handles, hit], [*labels, f"{collided} that collide"]) if collided else (handles, labels)


def _over_time(paths: pd.DataFrame, scene: dict[str, Any], title: str) -> Figure:
    figure = Figure(figsize=(7.2, 3.2), layout="constrained")
    axes = figure.subplots()
    for index, (_, group) in enumerate(paths.groupby("trial")):
        position = [state[0] for state in group["state"]]
        axes.plot(
            group["step"] * scene["dt"], position, color=BLUE, lw=0.8, alpha=0.45, label="paths" if not index else None
        )
    axes.axhline(scene["goal"][0], color=GREEN, lw=1.5, ls="--", label="goal")
    axes.set(xlabel="time (s)", ylabel="position", title=title)
    figure.legend(loc="outside lower center", ncols=5)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a PNG whole or not at all."""
    temporary = path.with_name(f".tmp-{path.name}")
    figure.savefig(temporary, dpi=200, format="png")
    temporary.replace(path)
