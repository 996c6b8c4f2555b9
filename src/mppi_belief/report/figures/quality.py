"""Draws cost and collisions against time per step and number of sampled paths, by method."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from ..cell_results import METHOD_NAMES, CellResults, by_method, differing_labels
from ..statistics import Estimate
from .point_labels import place_labels
from .points import collision_rate, dodge, draw_estimates, mean_of, step_time
from .style import COLUMN, STYLE, drawing_style, method_look, method_order

Estimator = Callable[[CellResults], Estimate]


def quality_figure(cells: Sequence[CellResults]) -> Figure | None:
    """Draws cost (top) and collision rate (%) with 95 % intervals, one line per method.

    Left: against ms per step, with the setting at each point; cells without times are left out.
    Right: against sampled paths per step; methods that sample none are left out. None without
    trials.
    """
    groups = by_method([cell for cell in cells if len(cell.good)])
    methods = sorted(groups, key=method_order)
    if not methods:
        return None
    with drawing_style(STYLE):
        figure = Figure(figsize=(2 * COLUMN, 4.6), layout="constrained")
        panels = figure.subplots(2, 2, sharex="col", sharey="row")
        marks: list[Annotation] = []
        for row, estimate in zip(panels, (mean_of("cost"), collision_rate), strict=True):
            for index, method in enumerate(methods):
                group = groups[method]
                times = [step_time(cell).value for cell in group]
                numbers = [cell.samples or math.nan for cell in group]
                paths = dodge(numbers, index, len(methods), ratio=1.06)
                _draw_method(row[0], times, group, estimate, label=_legend_text(method, group))
                _draw_method(row[1], paths, group, estimate)
                marks += _settings_of_points(row[0], times, group, estimate)
        _label_quality_axes(panels)
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
        place_labels(figure, marks)
        return figure


def _draw_method(
    axes: Axes,
    x: Sequence[float],
    cells: Sequence[CellResults],
    estimate: Estimator,
    label: str = "",
) -> None:
    """Draws the cells of one method at those x that are finite."""
    pairs = [pair for pair in zip(x, cells, strict=True) if math.isfinite(pair[0])]
    estimates = [estimate(cell) for _, cell in pairs]
    look = method_look(cells[0].method)
    draw_estimates(axes, [position for position, _ in pairs], estimates, look, label=label)


def _legend_text(method: str, cells: Sequence[CellResults]) -> str:
    """Returns the name of a method and the settings that the texts at its points give."""
    name = METHOD_NAMES.get(method, method)
    keys = [key.rpartition(".")[2] for key in differing_labels(cells)[0]]
    return f"{name}: {', '.join(keys)}" if keys else name


def _settings_of_points(
    axes: Axes, x: Sequence[float], cells: Sequence[CellResults], estimate: Estimator
) -> list[Annotation]:
    """Returns the settings in which the cells of one method differ as labels, to be placed."""
    style: Any = {"color": method_look(cells[0].method).colour, "fontsize": 7, "zorder": 1}
    marks = []
    for position, cell, labels in zip(x, cells, differing_labels(cells), strict=True):
        point = (position, estimate(cell).value)
        if labels and all(math.isfinite(value) for value in point):
            text = ", ".join(labels.values())
            marks.append(axes.annotate(text, point, (0, 0), textcoords="offset points", **style))
    return marks


def _label_quality_axes(panels: np.ndarray) -> None:
    """Labels the axes: time, samples and cost logarithmic; an axis without data stays linear."""
    panels[0, 0].set(ylabel="cost", yscale="log")
    panels[0, 0].yaxis.set_major_locator(MaxNLocator(8))
    panels[1, 0].set(ylabel="trials that collide (%)", xlabel="median ms per step")
    panels[1, 1].set_xlabel("sampled paths per step")
    with_data = [axes for axes in panels[0] if math.isfinite(axes.dataLim.minposx)]
    for axes in with_data:
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    for axis in (panels[0, 0].yaxis, *(axes.xaxis for axes in with_data)):
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter("{x:g}")
