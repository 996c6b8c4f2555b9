"""Sweeps of one setting: Fig. 2 (the obstacle weight) and the theta sweep of Sec. VII, with what the paper says."""

import math
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from .. import published
from ..cell_results import METHOD_NAMES, CellResults, by_method
from .points import collision_rate, dodge, draw_estimates, mean_of
from .style import COLUMN, GREY, INK, STYLE, method_look, method_order

PUBLISHED_W_OBS = (1e2, 1e4)
BAND: Any = {"color": "#DDDDDD", "lw": 0}
HOLLOW: Any = {"color": INK, "mfc": "none", "marker": "s", "ms": 6, "mew": 0.8, "ls": "none"}


def figure_2(founds: Sequence[CellResults]) -> Figure | None:
    """Fig. 2: collision rate (%) and base cost against w_obs, a line a method, with 95 % intervals.

    From the paper: shaded, the range of its baselines; hollow, what it says of MPPI-Belief (a triangle: below 1 %).
    None without trials.
    """
    lines = _lines(founds, "w_obs", lambda w_obs: w_obs > 0)
    if not lines:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(COLUMN, 3.9), layout="constrained")
        panels = figure.subplots(2, 1, sharex=True)
        _published_rates(panels[0])
        for axes, estimate in zip(panels, (collision_rate, mean_of("cost")), strict=True):
            for index, (method, cells) in enumerate(lines.items()):
                x = dodge([found.labels["w_obs"] for found in cells], index, len(lines))
                draw_estimates(
                    axes,
                    x,
                    [estimate(found) for found in cells],
                    method_look(method),
                    label=METHOD_NAMES.get(method, method),
                )
        panels[0].set(xscale="log", ylabel="trials that collide (%)", title="(a)")
        panels[1].set(ylabel="base cost", xlabel=r"obstacle weight $w_\mathrm{obs}$", title="(b)")
        handles, labels = panels[1].get_legend_handles_labels()
        paper: Any = (Patch(**BAND), Line2D([], [], **HOLLOW))
        figure.legend([*handles, paper], [*labels, "paper"], loc="outside lower center", ncols=3)
        return figure


def theta_figure(founds: Sequence[CellResults]) -> Figure | None:
    """Collision rate (%), mean clearance (m) and cost against theta, with 95 % intervals; hollow: the paper's values.

    Where the text gives a range, a bar spans it. None without trials.
    """
    lines = _lines(founds, "theta", math.isfinite)
    if not lines:
        return None
    quantities = {
        "collide (%)": collision_rate,
        "clearance (m)": mean_of("clearance"),
        "cost": mean_of("cost"),
    }
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(COLUMN, 1.9), layout="constrained")
        panels = figure.subplots(1, 3)
        for axes, (title, estimate) in zip(panels, quantities.items(), strict=True):
            for method, cells in lines.items():
                theta = [found.labels["theta"] for found in cells]
                draw_estimates(
                    axes,
                    theta,
                    [estimate(found) for found in cells],
                    method_look(method),
                    label=METHOD_NAMES.get(method, method),
                )
            axes.set(title=title, xlabel=r"$\theta$")
            axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
        methods = panels[0].get_legend_handles_labels()
        paper = _published_theta(panels)
        figure.legend(
            [*methods[0], paper], [*methods[1], "paper"], loc="outside lower center", ncols=4
        )
        return figure


def _lines(founds: Sequence[CellResults], key: str, fits: Any) -> dict[str, list[CellResults]]:
    """The cells with trials to show, by method and then by what was swept."""
    there = [found for found in founds if len(found.good) and fits(found.labels[key])]
    methods = by_method(sorted(there, key=lambda found: float(found.labels[key])))
    return {method: methods[method] for method in sorted(methods, key=method_order)}


def _published_rates(axes: Axes) -> None:
    low, high = (100 * rate for rate in published.BASELINE_RANGE)
    axes.fill_between(PUBLISHED_W_OBS, low, high, zorder=0, **BAND)
    for w_obs, rate in published.BELIEF_BELOW.items():
        axes.plot(w_obs, 100 * rate, **HOLLOW | {"marker": "v" if rate else "s"})


def _published_theta(panels: Sequence[Axes]) -> Line2D:
    """Draw what the text says, None where it says nothing; the mark, for the legend."""
    rates = [
        (theta, 100 * low, 100 * high)
        for theta, row in published.THETA.items()
        for low, high in [row[0]]
    ]
    theta, lows, highs = (list(column) for column in zip(*rates, strict=True))
    middles = [(low + high) / 2 for low, high in zip(lows, highs, strict=True)]
    panels[0].vlines(theta, lows, highs, color=GREY, lw=0.8)
    (mark,) = panels[0].plot(theta, middles, **HOLLOW)
    for axes, name in zip(panels[1:], ("clearance", "cost"), strict=True):
        values = {theta: getattr(row, name) for theta, row in published.THETA.items()}
        told = {theta: value for theta, value in values.items() if value is not None}
        axes.plot([*told], [*told.values()], **HOLLOW)
    return mark
