"""Pictures of trials, from their kept trajectories and their scene."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

BLUE, ORANGE, GREEN, INK = "#0072B2", "#D55E00", "#009E73", "#222222"  # Okabe and Ito: safe for colour blindness
NAME = "trajectories.png"
STYLE: Any = {"font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False}


def trajectories(paths: pd.DataFrame, scene: dict[str, Any], collided: set[int], title: str) -> Figure:
    """True paths in the plane over sigma_o, as Fig. 1; for one-dimensional positions, over time."""
    with mpl.rc_context(STYLE):
        if len(scene["start"]) == 2:
            return _plane(paths, scene, collided, title)
        return _over_time(paths, scene, title)


def _plane(paths: pd.DataFrame, scene: dict[str, Any], collided: set[int], title: str) -> Figure:
    figure = Figure(figsize=(7.2, 5.2), layout="constrained")
    axes = figure.subplots()
    states = {trial: np.stack(list(group["state"])) for trial, group in paths.groupby("trial")}
    for trial, state in states.items():
        hit = trial in collided
        colour, order = (ORANGE, 4) if hit else (BLUE, 3)
        axes.plot(state[:, 0], state[:, 1], color=colour, lw=0.8, alpha=0.75 if hit else 0.45, zorder=order)
    _scenery(axes, scene)
    everything = np.vstack([*(state[:, :2] for state in states.values()), *scene["obstacles"], scene["goal"]])
    low, high = everything.min(axis=0) - 0.5, everything.max(axis=0) + 0.5
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="$p_x$ (m)", ylabel="$p_y$ (m)", title=title)
    axes.plot([], [], color=BLUE, lw=1.5, label=f"{len(states) - len(collided)} paths")
    if collided:
        axes.plot([], [], color=ORANGE, lw=1.5, label=f"{len(collided)} that collide")
    figure.legend(loc="outside lower center", ncols=5)
    return figure


def _scenery(axes: Axes, scene: dict[str, Any]) -> None:
    noise = scene["noise"]
    levels = np.asarray(noise["level"])
    shading = axes.pcolormesh(noise["x"], noise["y"], levels, cmap="Greys", vmin=0, shading="gouraud", zorder=0)
    axes.figure.colorbar(shading, ax=axes, label=r"$\sigma_o$ (m)", fraction=0.04, pad=0.02)
    for center in scene["obstacles"]:
        axes.add_patch(
            Circle(center, scene["radius"], facecolor="white", edgecolor=INK, lw=1.2, hatch="////", zorder=2)
        )
    axes.plot(*scene["start"], "o", color="white", mec=INK, ms=7, zorder=5, ls="none", label="start")
    axes.plot(*scene["goal"], "*", color=GREEN, mec=INK, ms=13, zorder=5, ls="none", label="goal")
    axes.set_aspect("equal")


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
