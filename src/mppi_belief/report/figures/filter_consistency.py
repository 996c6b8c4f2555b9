"""Where the Gaussian reduction is valid, over the curvature of the measurements, a column a system."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .points import draw_estimates
from .style import BLUE, COLUMN, GREEN, GREY, OTHER, STYLE, Look

if TYPE_CHECKING:
    from ..sections.nonlinearity import Point

LOOKS = {"ekf": Look(BLUE, "o", "-"), "ukf": Look(GREEN, "^", "-.")}
FAR = 3.0  # a NEES by its degrees of freedom from which on an axis is logarithmic
HOLLOW: Any = {"mfc": "none", "ls": ":"}


def consistency_figure(points: Sequence["Point"]) -> Figure | None:
    """Theorem 1's residual (top), NEES and NIS by their degrees of freedom with the 95 % band of a consistent filter,
    and the loss of cost against the oracle, all against the curvature; a line a filter. None without points."""
    systems = list(dict.fromkeys(point.system for point in points))
    if not systems:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(COLUMN * max(len(systems), 1.3), 5.2), layout="constrained")
        panels = figure.subplots(3, len(systems), sharex="col", squeeze=False)
        for column, system in zip(panels.T, systems, strict=True):
            cells = [point for point in points if point.system == system]
            column[0].set_title(system)
            _bands(column[1], cells)
            for index, filter in enumerate(dict.fromkeys(point.filter for point in cells)):
                _lines(
                    column,
                    [point for point in cells if point.filter == filter],
                    0.02 * (2 * index - 1),
                )
            _scale(column[1], cells)
            column[2].axhline(0, color=GREY, lw=0.6)
            column[2].set_xlabel(r"curvature $\kappa$")
        names = ("Theorem 1's residual", "by degrees of freedom", "loss to the oracle")
        for axes, name in zip(panels[:, 0], names, strict=True):
            axes.set_ylabel(name)
        handles, labels = panels[1, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=6)
        return figure


def _bands(axes: Axes, cells: Sequence["Point"]) -> None:
    """Shaded, that of NIS, the narrower one, darker."""
    curvatures = sorted({point.curvature for point in cells})
    for index, (name, shade) in enumerate((("NEES", "#DDDDDD"), ("NIS", "#AAAAAA"))):
        band = {point.curvature: point.bands[index] for point in cells}
        low, high = ([band[kappa][end] for kappa in curvatures] for end in (1, 2))
        axes.fill_between(
            curvatures, low, high, color=shade, lw=0, zorder=0, label=f"95 % band of {name}"
        )


def _scale(axes: Axes, cells: Sequence["Point"]) -> None:
    """Logarithmic where a filter is far off."""
    if max(point.nees.value for point in cells) > FAR:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")


def _lines(column: np.ndarray, cells: Sequence["Point"], aside: float) -> None:
    """One filter in all panels of a system, moved aside so that bars do not hide each other."""
    look, name = LOOKS.get(cells[0].filter, OTHER), cells[0].filter.upper()
    x = [point.curvature + aside for point in cells]
    column[0].plot(
        x, [point.residual for point in cells], color=look.colour, marker=look.marker, ls=look.line
    )
    draw_estimates(column[1], x, [point.nees for point in cells], look, label=f"NEES, {name}")
    draw_estimates(
        column[1], x, [point.nis for point in cells], look, label=f"NIS, {name}", **HOLLOW
    )
    draw_estimates(column[2], x, [point.loss for point in cells], look)
