"""Tests that texts beside points hide neither each other nor what can be spared."""

import itertools

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from mppi_belief.report.figures.point_labels import place_labels


def labelled(points: np.ndarray) -> tuple[Figure, Axes, list[Annotation]]:
    """Returns points (n, 2) on a line, each with its number as a label."""
    figure = Figure(figsize=(3, 2), layout="constrained")
    axes = figure.subplots()
    axes.plot(*points.T, "o-")
    texts = [
        axes.annotate(str(1000 + k), point, (0, 0), textcoords="offset points", size=7)
        for k, point in enumerate(points)
    ]
    place_labels(figure, texts)
    FigureCanvasAgg(figure).draw()
    return figure, axes, texts


def test_labels_of_points_close_together_do_not_overlap():
    x = np.array([0.0, 0.03, 0.06, 0.09, 0.5, 1.0])
    _, axes, texts = labelled(np.stack([x, np.zeros(6)], axis=1))
    boxes = [text.get_window_extent() for text in texts if text.get_visible()]
    assert len(boxes) == 6
    assert not any(first.overlaps(second) for first, second in itertools.combinations(boxes, 2))
    for box in boxes:
        assert axes.bbox.x0 - 1 <= box.x0 < box.x1 <= axes.bbox.x1 + 1


def test_a_label_stands_beside_the_line_not_on_it():
    _, axes, texts = labelled(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 0.0]]))
    line = axes.transData.transform(axes.lines[0].get_xydata())
    samples = np.concatenate(
        [np.linspace(first, second, 200) for first, second in itertools.pairwise(line)]
    )
    for text in texts:
        box = text.get_window_extent()
        assert not np.any(np.all((samples >= box.min) & (samples <= box.max), axis=1))


def test_a_label_without_a_free_spot_is_hidden():
    _, _, texts = labelled(np.zeros((60, 2)))
    visible = [text for text in texts if text.get_visible()]
    assert 4 <= len(visible) < 60
