"""Draws one trial: its true path, its belief, and the paths that its planner sampled from it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .lines import draw_bands, obstacle_bands
from .plane import (
    ELLIPSE_EVERY,
    ELLIPSE_SIGMAS,
    LIGHT_GREYS,
    add_noise_bar,
    axis_labels,
    belief_ellipse,
    draw_scene,
    ellipse_boxes,
    largest_noise,
    stacked_steps,
    start_and_goal,
    view_box,
)
from .style import GREEN, INK, SCREEN, drawing_style, method_look, wrapped_title

FANS = 5  # steps at which the sampled paths are shown


def one_trial_figure(
    path: Sequence[dict[str, Any]],
    scene: dict[str, Any],
    samples: dict[str, Any] | None,
    method: str,
    title: str,
) -> Figure:
    """Draws a trial's path over sigma_o, with belief (2 sigma) and sampled paths at some steps.

    Of a position that is not in a plane the first coordinate is drawn over time. `path` holds the
    steps 0..T with state (nx,), mean (nx,) and cov (nx nx,). `samples` has "position" (T, S, H, d)
    and "weight" (T, S), or is None.
    """
    colour = method_look(method).colour
    with drawing_style(SCREEN):
        draw = _draw_in_plane if len(scene["start"]) == 2 else _draw_in_time
        return draw(pd.DataFrame(list(path)), scene, samples, colour, title)


def _draw_in_plane(
    steps: pd.DataFrame, scene: dict[str, Any], samples: Any, colour: str, title: str
) -> Figure:
    """Draws a trial in the plane."""
    position, mean, cov = stacked_steps(steps)
    corners = view_box([position, *ellipse_boxes(mean, cov)], scene)
    width, height = corners[1] - corners[0]
    figure = Figure(figsize=(7.2, 1.3 + 6.0 * min(height / width, 1.2)), layout="constrained")
    axes = figure.subplots()
    shading = draw_scene(axes, scene, cmap=LIGHT_GREYS, top=largest_noise(scene, corners))

    # Sampled paths, from the mean of the belief on.
    for k, paths, weights in _fans(samples, len(position) - 1):
        starts = np.broadcast_to(mean[k, :2], (len(paths), 1, 2))
        _add_sampled_paths(axes, np.concatenate([starts, paths], axis=1), weights)

    # Belief and true path.
    for k in range(0, len(mean), ELLIPSE_EVERY):
        style: Any = {"fill": False, "ec": colour, "lw": 1.0, "zorder": 5}
        axes.add_patch(belief_ellipse(mean[k], cov[k], **style))
    axes.plot(*mean[::ELLIPSE_EVERY, :2].T, "+", color=colour, ms=5, zorder=5)
    axes.plot(*position.T, color=colour, lw=2, zorder=4.5)

    axes.set(xlim=corners[:, 0], ylim=corners[:, 1], title=wrapped_title(title))
    labels = axis_labels(scene)
    axes.set(xlabel=labels[0], ylabel=labels[1])
    add_noise_bar(figure, axes, shading, scene, fraction=0.04, pad=0.02, shrink=0.8)
    true_path = Line2D([], [], color=colour, lw=2)
    belief = Line2D([], [], marker="o", mfc="none", mec=colour, ms=8, ls="none")
    handles = [*start_and_goal(), true_path, belief]
    _add_trial_legend(figure, handles, ["start", "goal"], samples)
    return figure


def _draw_in_time(
    steps: pd.DataFrame, scene: dict[str, Any], samples: Any, colour: str, title: str
) -> Figure:
    """Draws the first coordinate of a trial over time (s)."""
    state, mean, cov = (
        np.stack(list(steps[name])).astype(float) for name in ("state", "mean", "cov")
    )
    time = scene["dt"] * np.arange(len(steps))
    figure = Figure(figsize=(7.2, 3.6), layout="constrained")
    axes = figure.subplots()

    # Sampled paths, from the mean of the belief on.
    for k, paths, weights in _fans(samples, len(state) - 1):
        times = time[k] + scene["dt"] * np.arange(paths.shape[1] + 1)
        starts = np.full((len(paths), 1), mean[k, 0])
        values = np.concatenate([starts, paths[..., 0]], axis=1)
        points = np.stack([np.broadcast_to(times, values.shape), values], axis=-1)
        _add_sampled_paths(axes, points, weights)

    # Belief and true path.
    reach = ELLIPSE_SIGMAS * np.sqrt(cov[:, 0])
    low = mean[:, 0] - reach
    high = mean[:, 0] + reach
    band = axes.fill_between(time, low, high, color=colour, alpha=0.25, lw=0, zorder=4)
    axes.plot(time, state[:, 0], color=colour, lw=2, zorder=5)
    goal = axes.axhline(scene["goal"][0], color=GREEN, lw=1.5, ls="--", zorder=2)

    draw_bands(axes, obstacle_bands(scene))
    label = axis_labels(scene)[0]
    axes.set(xlim=(time[0], time[-1]), xlabel="time (s)", ylabel=label)
    axes.set_title(wrapped_title(title))
    true_path = Line2D([], [], color=colour, lw=2)
    _add_trial_legend(figure, [goal, true_path, band], ["goal"], samples)
    return figure


def _fans(samples: Any, steps: int) -> list[tuple[int, np.ndarray, np.ndarray]]:
    """Returns evenly spaced steps with the paths (S, H, d) sampled there and their weights (S,)."""
    if not samples:
        return []
    positions = samples["position"]
    weights = samples["weight"]
    stride = max(-(-steps // FANS), 1)
    return [
        (k, np.asarray(positions[k], float), np.asarray(weights[k], float))
        for k in range(0, steps, stride)
    ]


def _add_sampled_paths(axes: Axes, paths: np.ndarray, weights: np.ndarray) -> None:
    """Draws sampled paths (S, H + 1, 2), heavier ones darker and on top."""
    order = np.argsort(weights)
    darkness = np.sqrt(weights[order] / max(weights.max(), 1e-12))
    colours = [to_rgba(INK, 0.08 + 0.6 * share) for share in darkness]
    lines = LineCollection(list(paths[order]), linewidths=0.6, colors=colours, zorder=3)
    axes.add_collection(lines, autolim=False)


def _add_trial_legend(figure: Figure, handles: list[Any], labels: list[str], samples: Any) -> None:
    labels = [*labels, "true path", rf"belief (${ELLIPSE_SIGMAS:.0f}\sigma$)"]
    if samples:
        handles = [*handles, Line2D([], [], color=INK, lw=0.6)]
        labels = [*labels, "sampled paths"]
    figure.legend(handles, labels, loc="outside lower center", ncols=5)
