"""One trial step by step as an animated GIF: the belief, and the paths that the planner sampled from it."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
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
    LIGHT,
    SIDE_BY_SIDE,
    SIGMAS,
    around,
    darkest,
    draw_scene,
    ellipse,
    ends,
    kept_in_plane,
    reach,
    spread,
    stacked,
    window,
)
from .style import GREEN, INK, ORANGE, STYLE, method_look, method_order

FRAMES = 60  # steps are left out of longer trials
FRAME, HOLD = 100, 1500  # ms, of every frame and of the last one
WIDTH, PIXELS = 6.0, 150  # inches, per inch
GREYS, MIXES = (
    112,
    8,
)  # colours of the palette: greys, and of each other colour with white, grey and ink
SMALL = 0.8  # marks and edges against those of larger pictures


class Show(NamedTuple):
    """One trial of one cell."""

    found: CellResults
    scene: dict[str, Any]
    position: np.ndarray  # (T + 1, 2)
    mean: np.ndarray  # (T + 1, n)
    cov: np.ndarray  # (T + 1, n, n)
    samples: np.ndarray  # (T, S, H, 2)
    weights: np.ndarray  # (T, S)
    hit: np.ndarray  # (T + 1,) whether it has collided by then


class Moving(NamedTuple):
    """What changes in a panel from frame to frame."""

    samples: LineCollection
    path: Line2D
    belief: Ellipse
    center: Line2D
    title: Text


def write_animation(founds: Sequence[CellResults], path: Path) -> bool:
    """Write a GIF of the recorded trial of at most two cells, a panel each: sigma_o (m), the true path so far,
    the belief (mean and 2 sigma), the paths sampled at this step, heavier ones darker.

    Cells without a recording of samples or without the path of that trial are left out; where none is left,
    False is returned and nothing written.
    """
    ordered = sorted(founds, key=lambda found: method_order(found.method))
    shows = [show for show in map(_show, ordered) if show is not None][:2]
    if not shows:
        return False
    steps = max(len(show.position) for show in shows)
    shown = [*range(0, steps - 1, -(-(steps - 1) // FRAMES)), steps - 1]
    with mpl.rc_context(STYLE):
        frames = list(_frames(shows, shown))
    palette = _palette([method_look(show.found.method).colour for show in shows])
    frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    durations = [FRAME] * (len(frames) - 1) + [HOLD]
    later = {"save_all": True, "append_images": frames[1:], "duration": durations, "loop": 0}
    write_whole(path, lambda temporary: frames[0].save(temporary, format="GIF", **later))
    return True


def _show(found: CellResults) -> Show | None:
    samples = (found.recording or {}).get("samples")
    kept = kept_in_plane(found)
    if not samples or found.recording is None or kept is None:
        return None
    scene, paths = kept
    steps = paths[paths["trial"] == found.recording["trial"]]
    if len(steps) < 2:
        return None
    position, mean, cov = stacked(steps)
    away = np.linalg.norm(position[:, None] - np.reshape(scene["obstacles"], (-1, 2)), axis=-1)
    hit = np.logical_or.accumulate((away <= scene["radius"]).any(axis=1))
    return Show(
        found,
        scene,
        position,
        mean,
        cov,
        np.asarray(samples["position"]),
        np.asarray(samples["weight"]),
        hit,
    )


def _frames(shows: Sequence[Show], steps: Sequence[int]) -> Iterator[Image.Image]:
    corners = around(
        [window([show.position, *reach(show.mean, show.cov)], show.scene) for show in shows]
    )
    width, height = corners[1] - corners[0]
    size = (WIDTH, min(1.0 + (WIDTH - 1.2) / len(shows) * height / width, WIDTH))
    figure = Figure(figsize=size, dpi=PIXELS, layout="compressed")
    canvas = FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(shows), sharex=True, sharey=True, squeeze=False)[0]
    top = max(darkest(show.scene, corners) for show in shows)
    for axes, show in zip(panels, shows, strict=True):
        shading = draw_scene(axes, show.scene, size=SMALL, cmap=LIGHT, top=top)
        axes.set(xlabel="$p_x$ (m)", title="t")
    panels[0].set(xlim=corners[:, 0], ylim=corners[:, 1], ylabel="$p_y$ (m)")
    figure.colorbar(shading, ax=panels, label=r"$\sigma_o$ (m)", fraction=0.04, pad=0.01, aspect=30)
    moving = [_start(axes, show) for axes, show in zip(panels, shows, strict=True)]
    _explain(figure, shows)
    canvas.draw()
    figure.set_layout_engine("none")
    for step in steps:
        for parts, show in zip(moving, shows, strict=True):
            _move(parts, show, min(step, len(show.position) - 1))
        canvas.draw()
        yield Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())


def _start(axes: Axes, show: Show) -> Moving:
    colour = method_look(show.found.method).colour
    samples = LineCollection([], linewidths=0.6, zorder=3)
    axes.add_collection(samples, autolim=False)
    (path,) = axes.plot([], [], color=colour, lw=2, zorder=6)
    belief = ellipse(show.mean[0], show.cov[0], fill=False, ec=colour, lw=1.6, zorder=5)
    axes.add_patch(belief)
    (center,) = axes.plot([], [], "+", color=colour, ms=7, mew=1.6, zorder=7)
    return Moving(samples, path, belief, center, axes.title)


def _move(parts: Moving, show: Show, step: int) -> None:
    parts.path.set_data(*show.position[: step + 1].T)
    mean, cov = show.mean[step, :2], show.cov[step]
    parts.center.set_data(mean[:1], mean[1:])
    parts.belief.set_visible(bool(np.all(np.isfinite(cov))))
    if parts.belief.get_visible():
        (width, height), angle = spread(cov)
        parts.belief.set(center=mean, width=width, height=height, angle=angle)
    if step < len(show.samples):
        order = np.argsort(show.weights[step])
        share = np.sqrt(show.weights[step][order] / max(show.weights[step].max(), 1e-12))
        parts.samples.set_segments(list(show.samples[step][order]))
        parts.samples.set_color([to_rgba(INK, 0.12 + 0.75 * part) for part in share])
    else:
        parts.samples.set_segments([])
    time, hit = step * show.scene["dt"], bool(show.hit[step])
    parts.title.set_text(f"{show.found.name}, {time:.1f} s{': collided' if hit else ''}")
    parts.title.set_color(ORANGE if hit else INK)


def _explain(figure: Figure, shows: Sequence[Show]) -> None:
    colours = [method_look(show.found.method).colour for show in shows]
    path = tuple(Line2D([], [], color=colour, lw=2) for colour in colours)
    belief = tuple(
        Line2D([], [], marker="o", mfc="none", mec=colour, mew=1.6, ms=7, ls="none")
        for colour in colours
    )
    handles: Any = [*ends(SMALL), path, belief, Line2D([], [], color=INK, lw=0.6)]
    labels = [
        "start",
        "goal",
        "true path",
        f"belief (${SIGMAS:.0f}\\sigma$)",
        "sampled paths, heavier ones darker",
    ]
    figure.legend(handles, labels, handler_map=SIDE_BY_SIDE, loc="outside lower center", ncols=5)


def _palette(colours: Sequence[str]) -> Image.Image:
    """What the frames are made of; one palette, so that what stands still is the same pixels in all of them."""
    greys = np.linspace([0, 0, 0], [1, 1, 1], GREYS)
    accents = [to_rgb(colour) for colour in (*dict.fromkeys(colours), GREEN, ORANGE)]
    mixes = [
        np.linspace(to_rgb(other), accent, MIXES)
        for accent in accents
        for other in ("white", "silver", INK)
    ]
    table = Image.new("P", (1, 1))
    table.putpalette(np.round(255 * np.vstack([greys, *mixes])).astype(int).ravel().tolist())
    return table
