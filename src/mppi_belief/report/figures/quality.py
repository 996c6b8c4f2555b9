"""Quality per time: cost and collisions against the time of a step and the number of sampled paths."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from ..cell_results import METHOD_NAMES, CellResults, by_method, differing_labels
from ..statistics import Estimate
from .points import collision_rate, dodge, draw_estimates, mean_of, step_time
from .style import COLUMN, STYLE, method_look, method_order


def quality_figure(founds: Sequence[CellResults]) -> Figure | None:
    """Cost (top) and collision rate (%) against ms per step (left) and sampled paths per step, with 95 % intervals.

    A line a method through its settings, whose values stand at the points on the left; a method that samples
    nothing is not on the right, a cell without times not on the left. None without trials.
    """
    there = by_method([found for found in founds if len(found.good)])
    methods = {method: there[method] for method in sorted(there, key=method_order)}
    if not methods:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(2 * COLUMN, 4.6), layout="constrained")
        panels = figure.subplots(2, 2, sharex="col", sharey="row")
        for row, estimate in zip(panels, (mean_of("cost"), collision_rate), strict=True):
            for index, (method, cells) in enumerate(methods.items()):
                times = [step_time(found).value for found in cells]
                paths = dodge(
                    [found.samples or math.nan for found in cells], index, len(methods), ratio=1.06
                )
                _line(row[0], times, cells, estimate, label=_title(method, cells))
                _line(row[1], paths, cells, estimate)
                _name_points(
                    row[0],
                    times,
                    [estimate(found).value for found in cells],
                    cells,
                    above=index == 0,
                )
        _axes(panels)
        figure.legend(
            *panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4
        )
        return figure


def _line(
    axes: Axes,
    x: Sequence[float],
    cells: Sequence[CellResults],
    estimate: Callable[[CellResults], Estimate],
    label: str = "",
) -> None:
    """The cells of one method that have an x."""
    there = [(at, estimate(found)) for at, found in zip(x, cells, strict=True) if math.isfinite(at)]
    draw_estimates(
        axes,
        [at for at, _ in there],
        [value for _, value in there],
        method_look(cells[0].method),
        label=label,
    )


def _title(method: str, cells: Sequence[CellResults]) -> str:
    """The method, and what the values at its points are."""
    keys = [name.rpartition(".")[2] for name in differing_labels(cells)[0]]
    return ": ".join([METHOD_NAMES.get(method, method), *([", ".join(keys)] if keys else [])])


def _name_points(
    axes: Axes, x: Sequence[float], y: Sequence[float], cells: Sequence[CellResults], *, above: bool
) -> None:
    """The values of what tells the cells of one method apart, beside their points."""
    style: Any = {
        "color": method_look(cells[0].method).colour,
        "fontsize": 7,
        "va": "center",
        "zorder": 1,
    }  # below the data
    for at, value, setting in zip(x, y, differing_labels(cells), strict=True):
        if math.isfinite(at) and math.isfinite(value):
            offset = (4, 6 if above else -6)  # points
            axes.annotate(
                ", ".join(setting.values()),
                (at, value),
                offset,
                textcoords="offset points",
                **style,
            )


def _axes(panels: np.ndarray) -> None:
    """Logarithmic axes of time, samples and cost with plain numbers; an axis without data stays as it is."""
    panels[0, 0].set(ylabel="cost", yscale="log")
    panels[0, 0].yaxis.set_major_locator(MaxNLocator(8))
    panels[1, 0].set(ylabel="trials that collide (%)", xlabel="median ms per step")
    panels[1, 1].set_xlabel("sampled paths per step")
    used = [axes for axes in panels[0] if math.isfinite(axes.dataLim.minposx)]
    for axes in used:
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    for axis in (panels[0, 0].yaxis, *(axes.xaxis for axes in used)):
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter("{x:g}")
