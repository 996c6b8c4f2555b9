"""Draws the results of a study of any problem: against each swept number, or cell by cell."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from ..cell_results import CellResults, cell_titles, differing_labels
from ..statistics import Estimate
from .points import collision_rate, draw_estimates, mean_of
from .style import BLUE, COLUMN, GREEN, STYLE, Look, drawing_style, method_look

LOG_RATIO = 20.0  # a key whose values span this factor or more has a logarithmic axis; a choice
COLOURS = (BLUE, "#CC79A7", GREEN, "#56B4E9", "#E69F00", "#7B3294", "#000000", "#999999")
MARKERS = "os^DvPX*"
LINES = ("-", "--", "-.", ":")
ROW_HEIGHT = 0.22  # inches per cell of a picture cell by cell
LEGEND_ROW = 0.14  # inches

Panel = tuple[str, Callable[[CellResults], Estimate]]  # the label of an axis, and what it shows


def swept_numbers(cells: Sequence[CellResults]) -> list[str]:
    """Returns the keys that differ between the cells and have numbers; the seed is no such key."""
    numbers = []
    labels = differing_labels(cells)
    for key in labels[0] if labels else []:
        values = [cell_labels[key] for cell_labels in labels if cell_labels[key] != "-"]
        if key != "seed" and all(map(_is_number, values)):
            numbers.append(key)
    return numbers


def swept_figure(cells: Sequence[CellResults], key: str) -> Figure | None:
    """Draws cost and collision rate (%) against a swept number, with 95 % intervals.

    A line joins the cells that differ in nothing else. Cells without the key are left out. Without
    obstacles there are no collisions, and one panel. None where no cell has trials.
    """
    curves = _curves(cells, key)
    if not curves:
        return None
    panels = _panels(cells)
    height = 0.6 + 1.6 * len(panels) + LEGEND_ROW * (len(curves) > 1) * (len(curves) + 1)
    with drawing_style(STYLE):
        figure = Figure(figsize=(COLUMN, height), layout="constrained")
        grid = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (label, estimate) in zip(grid, panels, strict=True):
            axes.set_ylabel(label)
            for index, (name, curve) in enumerate(curves.items()):
                x = [float(cell.labels[key]) for cell in curve]
                estimates = [estimate(cell) for cell in curve]
                look = _look(index, list(curves.values()))
                draw_estimates(axes, x, estimates, look, label=name)
        grid[-1].set_xlabel(key)
        _scale(grid[-1], [float(cell.labels[key]) for curve in curves.values() for cell in curve])
        if len(curves) > 1:
            handles, labels = grid[0].get_legend_handles_labels()
            figure.legend(handles, labels, loc="outside lower center", ncols=1)
        return figure


def cells_figure(cells: Sequence[CellResults]) -> Figure | None:
    """Draws cost and collision rate (%) of each cell with 95 % intervals, a row per cell.

    None where no cell has trials.
    """
    shown = [cell for cell in cells if len(cell.good)]
    if not shown:
        return None
    panels = _panels(shown)
    titles = cell_titles(shown)
    rows = np.arange(len(shown))
    with drawing_style(STYLE):
        size = (2 * COLUMN, 0.6 + ROW_HEIGHT * len(shown))
        figure = Figure(figsize=size, layout="constrained")
        grid = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        for axes, (label, estimate) in zip(grid, panels, strict=True):
            axes.set_xlabel(label)
            for row, cell in zip(rows, shown, strict=True):
                value, low, high = estimate(cell)
                look = method_look(cell.method)
                bars = [[max(value - low, 0.0)], [max(high - value, 0.0)]]
                style = {"color": look.colour, "marker": look.marker, "capsize": 1.5}
                if math.isfinite(value):
                    axes.errorbar([value], [row], xerr=bars, **style)
        grid[0].set_yticks(rows, titles)
        grid[0].set_ylim(len(shown) - 0.5, -0.5)
        return figure


def _curves(cells: Sequence[CellResults], key: str) -> dict[str, list[CellResults]]:
    """Groups the cells with trials that have the key by their other labels, sorted by the key."""
    curves: dict[str, list[CellResults]] = {}
    for cell, labels in zip(cells, differing_labels(cells), strict=True):
        if not len(cell.good) or labels[key] == "-":
            continue
        settings = {name: value for name, value in labels.items() if name != key and value != "-"}
        settings |= {"controller": cell.name} if "controller" in settings else {}
        texts = [
            value if name == "controller" else f"{name} {value}" for name, value in settings.items()
        ]
        curves.setdefault(", ".join(texts), []).append(cell)
    for curve in curves.values():
        curve.sort(key=lambda cell: float(cell.labels[key]))
    return curves


def _panels(cells: Sequence[CellResults]) -> list[Panel]:
    """Returns what is drawn: the cost and, where there are obstacles, the collision rate."""
    panels: list[Panel] = [("cost", mean_of("cost"))]
    if any(np.isfinite(cell.good["clearance"].to_numpy(dtype=float)).any() for cell in cells):
        panels.append(("trials that collide (%)", collision_rate))
    return panels


def _look(index: int, curves: Sequence[Sequence[CellResults]]) -> Look:
    """Returns the look of a curve: that of its method where each curve has another method."""
    methods = [curve[0].method for curve in curves]
    if len(set(methods)) == len(methods):
        return method_look(methods[index])
    colour = COLOURS[index % len(COLOURS)]
    return Look(colour, MARKERS[index % len(MARKERS)], LINES[index % len(LINES)])


def _scale(axes: Axes, values: Sequence[float]) -> None:
    """Makes the axis logarithmic where the values ask for it, with ticks at the values."""
    if min(values) > 0 and max(values) / min(values) >= LOG_RATIO:
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(FixedLocator(sorted(set(values))))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter("{x:g}")


def _is_number(text: str) -> bool:
    """Returns whether a label's text is a finite number."""
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
