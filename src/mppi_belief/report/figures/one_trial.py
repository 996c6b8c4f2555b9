"""One trial as a still picture: its true path, its belief, and what its planner sampled from it."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .plane import LIGHT, SIGMAS, darkest, draw_scene, ellipse, ends, reach, stacked, window
from .style import GREEN, INK, SCREEN, method_look

EVERY = 6  # steps from one belief ellipse to the next
FANS = 5  # how many steps' sampled paths are shown


def one_trial_figure(
    path: Sequence[dict[str, Any]],
    scene: dict[str, Any],
    samples: dict[str, Any] | None,
    method: str,
    title: str,
) -> Figure:
    """A trial's path over sigma_o (m) with the belief (2 sigma) at every sixth step and the paths sampled at some of
    them; for one-dimensional positions, over time.

    `path` are the steps 0..T with state (nx,), mean (nx,), cov (nx nx,); `samples` has "position" (T, S, H, d) and
    "weight" (T, S), or is None.
    """
    with mpl.rc_context(SCREEN):
        draw = _in_plane if len(scene["start"]) == 2 else _over_time
        return draw(pd.DataFrame(list(path)), scene, samples, method_look(method).colour, title)


def _in_plane(
    steps: pd.DataFrame, scene: dict[str, Any], samples: Any, colour: str, title: str
) -> Figure:
    position, mean, cov = stacked(steps)
    corners = window([position, *reach(mean, cov)], scene)
    width, height = corners[1] - corners[0]
    figure = Figure(figsize=(7.2, 1.3 + 6.0 * min(height / width, 1.2)), layout="constrained")
    axes = figure.subplots()
    shading = draw_scene(axes, scene, cmap=LIGHT, top=darkest(scene, corners))
    for k, paths, weights in _fans(samples, len(position) - 1):
        starts = np.broadcast_to(mean[k, :2], (len(paths), 1, 2))
        _add(axes, np.concatenate([starts, paths], axis=1), weights)
    for k in range(0, len(mean), EVERY):
        axes.add_patch(ellipse(mean[k], cov[k], fill=False, ec=colour, lw=1.0, zorder=5))
    axes.plot(*mean[::EVERY, :2].T, "+", color=colour, ms=5, zorder=5)
    axes.plot(*position.T, color=colour, lw=2, zorder=4.5)
    axes.set(
        xlim=corners[:, 0], ylim=corners[:, 1], xlabel="$p_x$ (m)", ylabel="$p_y$ (m)", title=title
    )
    figure.colorbar(shading, ax=axes, label=r"$\sigma_o$ (m)", fraction=0.04, pad=0.02, shrink=0.8)
    belief = Line2D([], [], marker="o", mfc="none", mec=colour, ms=8, ls="none")
    _explain(
        figure, [*ends(), Line2D([], [], color=colour, lw=2), belief], ["start", "goal"], samples
    )
    return figure


def _over_time(
    steps: pd.DataFrame, scene: dict[str, Any], samples: Any, colour: str, title: str
) -> Figure:
    state, mean = (np.stack(list(steps[name])).astype(float) for name in ("state", "mean"))
    deviation = np.sqrt(np.stack(list(steps["cov"])).astype(float)[:, 0])
    time = scene["dt"] * np.arange(len(steps))
    figure = Figure(figsize=(7.2, 3.6), layout="constrained")
    axes = figure.subplots()
    for k, paths, weights in _fans(samples, len(state) - 1):
        ahead = time[k] + scene["dt"] * np.arange(paths.shape[1] + 1)
        values = np.concatenate([np.full((len(paths), 1), mean[k, 0]), paths[..., 0]], axis=1)
        _add(axes, np.stack([np.broadcast_to(ahead, values.shape), values], axis=-1), weights)
    low, high = mean[:, 0] - SIGMAS * deviation, mean[:, 0] + SIGMAS * deviation
    band = axes.fill_between(time, low, high, color=colour, alpha=0.25, lw=0, zorder=4)
    axes.plot(time, state[:, 0], color=colour, lw=2, zorder=5)
    goal = axes.axhline(scene["goal"][0], color=GREEN, lw=1.5, ls="--", zorder=2)
    axes.set(xlim=(time[0], time[-1]), xlabel="time (s)", ylabel="position", title=title)
    _explain(figure, [goal, Line2D([], [], color=colour, lw=2), band], ["goal"], samples)
    return figure


def _fans(samples: Any, steps: int) -> list[tuple[int, np.ndarray, np.ndarray]]:
    """Some steps, evenly, with the paths (S, H, d) sampled there and their weights (S,)."""
    if not samples:
        return []
    chosen = range(0, steps, max(-(-steps // FANS), 1))
    return [
        (k, np.asarray(samples["position"][k], float), np.asarray(samples["weight"][k], float))
        for k in chosen
    ]


def _add(axes: Axes, paths: np.ndarray, weights: np.ndarray) -> None:
    """Sampled paths (S, H + 1, 2), heavier ones darker and on top."""
    order = np.argsort(weights)
    share = np.sqrt(weights[order] / max(weights.max(), 1e-12))
    colours = [to_rgba(INK, 0.08 + 0.6 * part) for part in share]
    axes.add_collection(
        LineCollection(list(paths[order]), linewidths=0.6, colors=colours, zorder=3), autolim=False
    )


def _explain(figure: Figure, handles: list[Any], labels: list[str], samples: Any) -> None:
    labels = [*labels, "true path", rf"belief (${SIGMAS:.0f}\sigma$)"]
    if samples:
        handles, labels = [*handles, Line2D([], [], color=INK, lw=0.6)], [*labels, "sampled paths"]
    figure.legend(handles, labels, loc="outside lower center", ncols=5)
