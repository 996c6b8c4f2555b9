"""The curves of a certificate, as it describes them: nothing here knows what they mean."""

import math
from collections.abc import Sequence
from textwrap import fill
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ...results.certificate import Line, Panel
from .style import BLUE, COLUMN, GREEN, GREY, INK, ORANGE, STYLE

COLOURS = (BLUE, "#E69F00", GREEN, "#CC79A7", "#56B4E9", INK, ORANGE, GREY)
TITLE_WIDTH, LABEL_WIDTH = 52, 34  # characters that fit
MOST_INSIDE = 4  # labels that leave room for curves
LOOKS: dict[str, Any] = {
    "line": {"ls": "-"},
    "dashed": {"ls": "--", "color": GREY, "lw": 0.9},
    "points": {"ls": "none", "marker": "o", "ms": 3.2},
}


def certificate_figure(panels: Sequence[Panel]) -> Figure | None:
    """The panels of a certificate side by side, at most two in a row; None without any."""
    if not panels:
        return None
    columns = min(len(panels), 2)
    rows = -(-len(panels) // columns)
    height = 2.9 if any(_is_crowded(panel) for panel in panels) else 2.4  # inches
    with mpl.rc_context(STYLE):
        engine = ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.08)
        figure = Figure(figsize=(columns * COLUMN * 0.95, rows * height), layout=engine)
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for at, panel in zip(axes, panels, strict=False):
            _draw(at, panel)
        for left in axes[len(panels) :]:
            left.remove()
        return figure


def _draw(axes: Axes, panel: Panel) -> None:
    dashed = [line for line in panel.lines if line.look == "dashed"]
    for index, line in enumerate(panel.lines):
        _curve(axes, line, COLOURS[index % len(COLOURS)], second=line in dashed[1:])
    axes.set(
        title=fill(panel.title, TITLE_WIDTH),
        xlabel=fill(panel.x, LABEL_WIDTH),
        ylabel=fill(panel.y, LABEL_WIDTH),
    )
    if "x" in panel.log:
        axes.set_xscale("log")
        _decades(axes.xaxis, axes.get_xlim())
    if "y" in panel.log:
        axes.set_yscale("log")
        _decades(axes.yaxis, axes.get_ylim())
    if _is_crowded(panel):
        axes.legend(frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
    elif any(line.label for line in panel.lines):
        axes.legend(frameon=False)


def _is_crowded(panel: Panel) -> bool:
    """Whether the legend has to go below."""
    return sum(bool(line.label) for line in panel.lines) > MOST_INSIDE


def _decades(axis: Axis, limits: tuple[float, float]) -> None:
    """Labels at powers of ten or, where fewer than two are in sight, at 1, 2 and 5 of each."""
    low, high = (math.log10(limit) for limit in limits)
    axis.set_minor_formatter(NullFormatter())
    if math.floor(high) - math.ceil(low) < 1:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _curve(axes: Axes, line: Line, colour: str, second: bool) -> None:
    """One curve, dotted if it is a `second` dashed one; an interval is a bar at a point and a band around a line."""
    look = {"color": colour, **LOOKS[line.look]} | ({"ls": ":"} if second else {})
    axes.plot(line.x, line.y, label=line.label, **look)
    if line.low is None or line.high is None:
        return
    if line.look == "points":
        axes.vlines(line.x, line.low, line.high, color=look["color"], lw=0.9)
    else:
        axes.fill_between(line.x, line.low, line.high, color=look["color"], alpha=0.18, lw=0)
