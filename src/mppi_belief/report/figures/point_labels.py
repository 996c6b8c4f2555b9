"""Places the texts beside points so that they hide neither each other nor what is drawn."""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

DISTANCES = (5.0, 9.0, 14.0)  # points, from a point to its text
DIRECTIONS = ((1, 1), (1, -1), (-1, 1), (-1, -1), (0, 1), (0, -1), (1, 0), (-1, 0))
ALIGNMENTS = {
    -1: {"ha": "right", "va": "top"},
    0: {"ha": "center", "va": "center"},
    1: {"ha": "left", "va": "bottom"},
}
SAMPLE_SPACING = 2.0  # pixels between the samples of a line
CLEARANCE = 1.0  # pixels around a text


def place_labels(figure: Figure, labels: Sequence[Annotation]) -> None:
    """Moves each label to a free spot beside its point; hides those for which there is none.

    A spot may cover a line, where it must, but no other label and nothing outside of the axes. The
    figure is laid out first, so labels are placed when all else is drawn.
    """
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    placed: dict[Axes, list[Bbox]] = {}
    drawn_points: dict[Axes, np.ndarray] = {}
    for label in labels:
        axes = label.axes
        assert isinstance(axes, Axes)
        if axes not in drawn_points:
            drawn_points[axes] = _drawn_points(axes)
        taken = placed.setdefault(axes, [])
        box = _best_spot(label, axes, taken, drawn_points[axes])
        label.set_visible(box is not None)
        if box is not None:
            taken.append(box)


def _best_spot(
    label: Annotation, axes: Axes, taken: Sequence[Bbox], points: np.ndarray
) -> Bbox | None:
    """Moves a label to its best spot; returns the box of that, None where none is free."""
    best: tuple[int, float, Bbox, dict[str, Any]] | None = None
    for distance, (dx, dy) in itertools.product(DISTANCES, DIRECTIONS):
        reach = distance if 0 in (dx, dy) else distance * 0.7
        spot: dict[str, Any] = {
            "ha": ALIGNMENTS[dx]["ha"],
            "va": ALIGNMENTS[dy]["va"],
            "position": (reach * dx, reach * dy),
        }
        label.set(**spot)
        box = label.get_window_extent().padded(CLEARANCE)
        inside = axes.bbox.padded(CLEARANCE)
        is_inside = inside.contains(box.x0, box.y0) and inside.contains(box.x1, box.y1)
        if not is_inside or any(map(box.overlaps, taken)):
            continue
        covered = int(np.sum(np.all((points >= box.min) & (points <= box.max), axis=1)))
        if best is None or (covered, distance) < best[:2]:
            best = (covered, distance, box, spot)
    if best is None:
        return None
    label.set(**best[3])
    return best[2]


def _drawn_points(axes: Axes) -> np.ndarray:
    """Returns points (n, 2) in pixels along all lines, marks and bars of some axes."""
    segments = [np.asarray(line.get_xydata(), dtype=float) for line in axes.lines]
    for collection in axes.collections:
        if isinstance(collection, LineCollection):
            segments += [np.asarray(segment, dtype=float) for segment in collection.get_segments()]
    samples = [np.zeros((0, 2))]
    for segment in segments:
        pixels = axes.transData.transform(segment)
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        for first, second in itertools.pairwise(pixels):
            count = int(np.hypot(*(second - first)) / SAMPLE_SPACING) + 2
            samples.append(np.linspace(first, second, count))
        samples.append(pixels)
    return np.concatenate(samples)
