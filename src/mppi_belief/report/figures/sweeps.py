"""Draws Fig. 2 (the obstacle weight) and the theta sweep of Sec. VII, with the paper's values."""

import math
from collections.abc import Callable, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from .. import published
from ..cell_results import METHOD_NAMES, CellResults, by_method
from .points import collision_rate, dodge, draw_estimates, mean_of
from .style import COLUMN, GREY, INK, STYLE, drawing_style, method_look, method_order

PUBLISHED_BAND: Any = {"color": "#DDDDDD", "lw": 0}
PUBLISHED_MARK: Any = {
    "color": INK,
    "mfc": "none",
    "marker": "s",
    "ms": 6,
    "mew": 0.8,
    "ls": "none",
}


def figure_2(cells: Sequence[CellResults]) -> Figure | None:
    """Draws Fig. 2: collision rate (%) and base cost against w_obs with 95 % intervals, by method.

    From the paper, where cells have its settings: the range of its baselines (shaded), and what
    it says of MPPI-Belief (hollow; a triangle means below 1 %). None without trials.
    """
    curves = _curves_by_method(cells, "w_obs", lambda w_obs: w_obs > 0)
    if not curves:
        return None
    with drawing_style(STYLE):
        figure = Figure(figsize=(COLUMN, 3.9), layout="constrained")
        panels = figure.subplots(2, 1, sharex=True)
        is_papers = any(cell.has_paper_settings(published.WEIGHT_KEY) for cell in cells)
        if is_papers:
            _draw_published_rates(panels[0])
        for axes, estimate in zip(panels, (collision_rate, mean_of("cost")), strict=True):
            for index, (method, curve) in enumerate(curves.items()):
                x = dodge([cell.labels["w_obs"] for cell in curve], index, len(curves))
                estimates = [estimate(cell) for cell in curve]
                label = METHOD_NAMES.get(method, method)
                draw_estimates(axes, x, estimates, method_look(method), label=label)
        panels[0].set(xscale="log", ylabel="trials that collide (%)", title="(a)")
        panels[1].set(ylabel="base cost", xlabel=r"obstacle weight $w_\mathrm{obs}$", title="(b)")

        handles, labels = panels[1].get_legend_handles_labels()
        if is_papers:
            paper: Any = (Patch(**PUBLISHED_BAND), Line2D([], [], **PUBLISHED_MARK))
            handles.append(paper)
            labels.append("paper")
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
        return figure


def theta_figure(cells: Sequence[CellResults]) -> Figure | None:
    """Draws collision rate (%), mean clearance (m) and cost against theta with 95 % intervals.

    Where cells have the paper's settings, hollow marks are its values; where the text gives a
    range, a bar spans it. None without trials.
    """
    curves = _curves_by_method(cells, "theta", math.isfinite)
    if not curves:
        return None
    quantities = {
        "collide (%)": collision_rate,
        "clearance (m)": mean_of("clearance"),
        "cost": mean_of("cost"),
    }
    with drawing_style(STYLE):
        figure = Figure(figsize=(COLUMN, 1.9), layout="constrained")
        panels = figure.subplots(1, 3)
        for axes, (title, estimate) in zip(panels, quantities.items(), strict=True):
            for method, curve in curves.items():
                theta = [cell.labels["theta"] for cell in curve]
                estimates = [estimate(cell) for cell in curve]
                label = METHOD_NAMES.get(method, method)
                draw_estimates(axes, theta, estimates, method_look(method), label=label)
            axes.set(title=title, xlabel=r"$\theta$")
            axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))

        handles, labels = panels[0].get_legend_handles_labels()
        if any(cell.has_paper_settings(published.THETA_KEY) for cell in cells):
            handles.append(_draw_published_theta(panels))
            labels.append("paper")
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
        return figure


def _curves_by_method(
    cells: Sequence[CellResults], key: str, is_shown: Callable[[float], bool]
) -> dict[str, list[CellResults]]:
    """Groups the cells with trials by method, sorted by the label `key` where `is_shown` holds."""
    shown = [cell for cell in cells if len(cell.good) and is_shown(cell.labels[key])]
    methods = by_method(sorted(shown, key=lambda cell: float(cell.labels[key])))
    return {method: methods[method] for method in sorted(methods, key=method_order)}


def _draw_published_rates(axes: Axes) -> None:
    """Draws the paper's collision rates (%) over w_obs."""
    low, high = (100 * rate for rate in published.BASELINE_RANGE)
    axes.fill_between(published.WEIGHT_RANGE, low, high, zorder=0, **PUBLISHED_BAND)
    for w_obs, rate in published.BELIEF_BELOW.items():
        marker = {"marker": "v" if rate else "s"}
        axes.plot(w_obs, 100 * rate, **PUBLISHED_MARK | marker)


def _draw_published_theta(panels: Sequence[Axes]) -> Line2D:
    """Draws the paper's values over theta; returns a mark for the legend."""
    # Collision rates, with a bar over each range.
    rows = published.PAPER_THETA
    lows = [100 * row.collision_rate[0] for row in rows.values()]
    highs = [100 * row.collision_rate[1] for row in rows.values()]
    middles = [(low + high) / 2 for low, high in zip(lows, highs, strict=True)]
    panels[0].vlines([*rows], lows, highs, color=GREY, lw=0.8)
    (mark,) = panels[0].plot([*rows], middles, **PUBLISHED_MARK)

    # Clearances and costs, where the text gives them.
    for axes, name in zip(panels[1:], ("clearance", "cost"), strict=True):
        values = {theta: getattr(row, name) for theta, row in rows.items()}
        given = {theta: value for theta, value in values.items() if value is not None}
        axes.plot([*given], [*given.values()], **PUBLISHED_MARK)
    return mark
