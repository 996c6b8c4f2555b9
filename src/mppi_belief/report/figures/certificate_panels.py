"""Draws the curves of a certificate as the certificate describes them."""

import math
from collections.abc import Sequence
from textwrap import fill
from typing import Any

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ...results.certificate import Line, Panel
from .style import BLUE, COLUMN, GREEN, GREY, INK, ORANGE, STYLE, drawing_style

CURVE_COLOURS = (BLUE, "#E69F00", GREEN, "#CC79A7", "#56B4E9", INK, ORANGE, GREY)
TITLE_WIDTH = 52  # characters that fit in a line
LABEL_WIDTH = 34  # characters that fit in a line
MOST_LABELS_INSIDE = 4  # more labels leave no room for the curves
CURVE_STYLES: dict[str, Any] = {
    "line": {"ls": "-"},
    "dashed": {"ls": "--", "color": GREY, "lw": 0.9},
    "points": {"ls": "none", "marker": "o", "ms": 3.2},
}


def certificate_figure(panels: Sequence[Panel]) -> Figure | None:
    """Draws the panels of a certificate, at most two in a row; None without any."""
    if not panels:
        return None
    columns = min(len(panels), 2)
    rows = -(-len(panels) // columns)
    height = 2.9 if any(_is_crowded(panel) for panel in panels) else 2.4  # inches
    with drawing_style(STYLE):
        engine = ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.08)
        figure = Figure(figsize=(columns * COLUMN * 0.95, rows * height), layout=engine)
        grid = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes, panel in zip(grid, panels, strict=False):
            _draw_panel(axes, panel)
        for unused in grid[len(panels) :]:
            unused.remove()
        return figure


def _draw_panel(axes: Axes, panel: Panel) -> None:
    """Draws one panel; of several dashed curves, those after the first are dotted."""
    dashed = [line for line in panel.lines if line.look == "dashed"]
    for index, line in enumerate(panel.lines):
        colour = CURVE_COLOURS[index % len(CURVE_COLOURS)]
        _draw_curve(axes, line, colour, dotted=line in dashed[1:])

    axes.set(title=fill(panel.title, TITLE_WIDTH))
    axes.set(xlabel=fill(panel.x, LABEL_WIDTH), ylabel=fill(panel.y, LABEL_WIDTH))
    if "x" in panel.log:
        axes.set_xscale("log")
        _label_decades(axes.xaxis, axes.get_xlim())
    if "y" in panel.log:
        axes.set_yscale("log")
        _label_decades(axes.yaxis, axes.get_ylim())

    if _is_crowded(panel):
        axes.legend(frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
    elif any(line.label for line in panel.lines):
        axes.legend(frameon=False)


def _is_crowded(panel: Panel) -> bool:
    """Returns whether the legend has to go below the panel."""
    return sum(bool(line.label) for line in panel.lines) > MOST_LABELS_INSIDE


def _label_decades(axis: Axis, limits: tuple[float, float]) -> None:
    """Labels powers of ten or, if fewer than two are in view, 1, 2 and 5 times each."""
    low, high = (math.log10(limit) for limit in limits)
    axis.set_minor_formatter(NullFormatter())
    if math.floor(high) - math.ceil(low) < 1:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _draw_curve(axes: Axes, line: Line, colour: str, dotted: bool) -> None:
    """Draws one curve; intervals are bars at points and a band around a line."""
    style = {"color": colour, **CURVE_STYLES[line.look]}
    if dotted:
        style["ls"] = ":"
    axes.plot(line.x, line.y, label=line.label, **style)
    if line.low is None or line.high is None:
        return
    if line.look == "points":
        axes.vlines(line.x, line.low, line.high, color=style["color"], lw=0.9)
    else:
        axes.fill_between(line.x, line.low, line.high, color=style["color"], alpha=0.18, lw=0)
