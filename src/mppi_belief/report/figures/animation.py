"""Animates one trial as a GIF: the belief, and the paths that the planner sampled from it."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from matplotlib.text import Text
from PIL import Image

from ...results.files import write_whole
from ..cell_results import CellResults
from .plane import (
    ELLIPSE_SIGMAS,
    LIGHT_GREYS,
    SIDE_BY_SIDE,
    add_noise_bar,
    axis_labels,
    belief_ellipse,
    draw_scene,
    ellipse_boxes,
    ellipse_shape,
    enclosing_box,
    kept_in_plane,
    largest_noise,
    shared_top,
    stacked_steps,
    start_and_goal,
    view_box,
)
from .style import GREEN, INK, ORANGE, STYLE, drawing_style, method_look, method_order

FRAMES = 60  # at most; longer trials leave out steps
FRAME_TIME = 100  # ms
LAST_FRAME_TIME = 1500  # ms
GIF_WIDTH = 6.0  # inches
GIF_DPI = 150
PALETTE_GREYS = 112  # greys in the palette
PALETTE_MIXES = 8  # mixtures of each other colour with white, with grey and with ink
MARK_SIZE = 0.8  # marks and edges, relative to those of larger pictures


class AnimatedTrial(NamedTuple):
    """Holds the recorded trial of one cell: T steps, S sampled paths of H steps each."""

    cell: CellResults
    scene: dict[str, Any]
    position: np.ndarray  # (T + 1, 2), m
    mean: np.ndarray  # (T + 1, n)
    cov: np.ndarray  # (T + 1, n, n)
    samples: np.ndarray  # (T, S, H, 2), positions of the sampled paths, m
    weights: np.ndarray  # (T, S)
    collided: np.ndarray  # (T + 1,) bool, whether the trial has collided up to this step


class MovingParts(NamedTuple):
    """Holds what changes in a panel from frame to frame."""

    samples: LineCollection
    path: Line2D
    belief: Ellipse
    center: Line2D
    title: Text


def write_animation(cells: Sequence[CellResults], path: Path) -> bool:
    """Writes a GIF of the recorded trial of at most two cells, a panel each.

    It shows sigma_o, the true path so far, the belief (mean and 2 sigma), and the paths sampled
    at this step, heavier ones darker. Cells without a recording of samples or without the path of
    that trial are left out; if none remains, returns False and writes nothing.
    """
    ordered = sorted(cells, key=lambda cell: method_order(cell.method))
    trials = [trial for trial in map(_recorded_trial, ordered) if trial is not None][:2]
    if not trials:
        return False

    # The frames, in one palette.
    last_step = max(len(trial.position) for trial in trials) - 1
    stride = -(-last_step // FRAMES)
    with drawing_style(STYLE):
        images = list(_draw_frames(trials, [*range(0, last_step, stride), last_step]))
    palette = _palette([method_look(trial.cell.method).colour for trial in trials])
    frames = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]

    durations = [FRAME_TIME] * (len(frames) - 1) + [LAST_FRAME_TIME]
    later = {"save_all": True, "append_images": frames[1:], "duration": durations, "loop": 0}
    write_whole(path, lambda temporary: frames[0].save(temporary, format="GIF", **later))
    return True


def _recorded_trial(cell: CellResults) -> AnimatedTrial | None:
    """Returns the recorded trial of a cell, None without its samples or its path in the plane."""
    samples = (cell.recording or {}).get("samples")
    scene_and_paths = kept_in_plane(cell)
    if not samples or cell.recording is None or scene_and_paths is None:
        return None
    scene, paths = scene_and_paths
    steps = paths[paths["trial"] == cell.recording["trial"]]
    if len(steps) < 2:
        return None
    position, mean, cov = stacked_steps(steps)
    collided_at = cell.recording["collided_at"]
    first_collision = len(position) if collided_at is None else collided_at
    return AnimatedTrial(
        cell=cell,
        scene=scene,
        position=position,
        mean=mean,
        cov=cov,
        samples=np.asarray(samples["position"]),
        weights=np.asarray(samples["weight"]),
        collided=np.arange(len(position)) >= first_collision,
    )


def _draw_frames(trials: Sequence[AnimatedTrial], steps: Sequence[int]) -> Iterator[Image.Image]:
    """Yields a frame per step; a trial that has ended stays at its last step."""
    # The panels, of equal scale.
    boxes = [
        view_box([trial.position, *ellipse_boxes(trial.mean, trial.cov)], trial.scene)
        for trial in trials
    ]
    corners = enclosing_box(boxes)
    width, height = corners[1] - corners[0]
    gif_height = min(1.0 + (GIF_WIDTH - 1.2) / len(trials) * height / width, GIF_WIDTH)
    figure = Figure(figsize=(GIF_WIDTH, gif_height), dpi=GIF_DPI, layout="compressed")
    canvas = FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(trials), sharex=True, sharey=True, squeeze=False)[0]

    # What stays the same in all frames; the layout is made once.
    top = shared_top(largest_noise(trial.scene, corners) for trial in trials)
    labels = axis_labels(trials[0].scene)
    for axes, trial in zip(panels, trials, strict=True):
        shading = draw_scene(axes, trial.scene, size=MARK_SIZE, cmap=LIGHT_GREYS, top=top)
        axes.set(xlabel=labels[0], title="t")
    panels[0].set(xlim=corners[:, 0], ylim=corners[:, 1], ylabel=labels[1])
    bar: Any = {"fraction": 0.04, "pad": 0.01, "aspect": 30}
    add_noise_bar(figure, panels, shading, trials[0].scene, **bar)
    moving = [_moving_parts(axes, trial) for axes, trial in zip(panels, trials, strict=True)]
    _add_animation_legend(figure, trials)
    canvas.draw()
    figure.set_layout_engine("none")

    for step in steps:
        for parts, trial in zip(moving, trials, strict=True):
            _move_to(parts, trial, min(step, len(trial.position) - 1))
        canvas.draw()
        yield Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())


def _moving_parts(axes: Axes, trial: AnimatedTrial) -> MovingParts:
    """Adds what moves to a panel."""
    colour = method_look(trial.cell.method).colour
    samples = LineCollection([], linewidths=0.6, zorder=3)
    axes.add_collection(samples, autolim=False)
    (path,) = axes.plot([], [], color=colour, lw=2, zorder=6)
    style: Any = {"fill": False, "ec": colour, "lw": 1.6, "zorder": 5}
    belief = belief_ellipse(trial.mean[0], trial.cov[0], **style)
    axes.add_patch(belief)
    (center,) = axes.plot([], [], "+", color=colour, ms=7, mew=1.6, zorder=7)
    return MovingParts(samples, path, belief, center, axes.title)


def _move_to(parts: MovingParts, trial: AnimatedTrial, step: int) -> None:
    """Shows one step of a trial."""
    # True path and belief.
    parts.path.set_data(*trial.position[: step + 1].T)
    mean = trial.mean[step, :2]
    cov = trial.cov[step]
    parts.center.set_data(mean[:1], mean[1:])
    parts.belief.set_visible(bool(np.all(np.isfinite(cov))))
    if parts.belief.get_visible():
        (width, height), angle = ellipse_shape(cov)
        parts.belief.set(center=mean, width=width, height=height, angle=angle)

    # Sampled paths, the heaviest on top; there are none at the last step.
    if step < len(trial.samples):
        order = np.argsort(trial.weights[step])
        heaviest = max(trial.weights[step].max(), 1e-12)
        darkness = np.sqrt(trial.weights[step][order] / heaviest)
        parts.samples.set_segments(list(trial.samples[step][order]))
        parts.samples.set_color([to_rgba(INK, 0.12 + 0.75 * share) for share in darkness])
    else:
        parts.samples.set_segments([])

    time = step * trial.scene["dt"]
    collided = bool(trial.collided[step])
    parts.title.set_text(f"{trial.cell.name}, {time:.1f} s{': collided' if collided else ''}")
    parts.title.set_color(ORANGE if collided else INK)


def _add_animation_legend(figure: Figure, trials: Sequence[AnimatedTrial]) -> None:
    """Adds the legend below the panels."""
    colours = [method_look(trial.cell.method).colour for trial in trials]
    path = tuple(Line2D([], [], color=colour, lw=2) for colour in colours)
    ring: Any = {"marker": "o", "mfc": "none", "mew": 1.6, "ms": 7, "ls": "none"}
    belief = tuple(Line2D([], [], mec=colour, **ring) for colour in colours)
    sampled = Line2D([], [], color=INK, lw=0.6)
    handles: Any = [*start_and_goal(MARK_SIZE), path, belief, sampled]
    labels = [
        "start",
        "goal",
        "true path",
        f"belief (${ELLIPSE_SIGMAS:.0f}\\sigma$)",
        "sampled paths, heavier ones darker",
    ]
    style: Any = {"handler_map": SIDE_BY_SIDE, "loc": "outside lower center", "ncols": 5}
    figure.legend(handles, labels, **style)


def _palette(colours: Sequence[str]) -> Image.Image:
    """Returns one palette for all frames, so that what does not move has the same pixels in all."""
    greys = np.linspace([0, 0, 0], [1, 1, 1], PALETTE_GREYS)
    mixes = [greys]
    for colour in (*dict.fromkeys(colours), GREEN, ORANGE):
        for neutral in ("white", "silver", INK):
            mixes.append(np.linspace(to_rgb(neutral), to_rgb(colour), PALETTE_MIXES))
    table = Image.new("P", (1, 1))
    table.putpalette(np.round(255 * np.vstack(mixes)).astype(int).ravel().tolist())
    return table
