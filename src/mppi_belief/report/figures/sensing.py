"""Draws Algorithm 1 with a sensor chosen to match: mean positions, and the cost of a limit."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, NullLocator

from ..cell_results import CellResults
from .points import draw_estimates, mean_of
from .style import COLUMN, GREY, INK, STYLE, drawing_style, method_look

SENSOR_LINES: Any = {"matched": "-", "fixed": (0, (1, 1))}
SENSORS = {"matched": "chosen sensor", "fixed": "fixed sensor"}


def sensing_figure(
    unlimited: Sequence[CellResults], limited: Sequence[CellResults]
) -> Figure | None:
    """Draws two panels about the choice of the sensor; None where no trials were kept.

    (a) Mean first coordinate (m) of the kept trials over time (s), one line per method and sensor.
    (b) Mean cost of Algorithm 1 against the limit of its sensor, with 95 % intervals. `limited` are
    its cells in rising order of "system.limit", where None stands for no limit.
    """
    kept_cells = [cell for cell in unlimited if not cell.paths.empty and cell.scene is not None]
    if not kept_cells:
        return None
    with drawing_style(STYLE):
        figure = Figure(figsize=(COLUMN, 3.9), layout="constrained")
        panels = figure.subplots(2, 1)
        _draw_mean_positions(panels[0], kept_cells)
        _draw_cost_over_limit(panels[1], unlimited, [cell for cell in limited if len(cell.good)])
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2)
        return figure


def _draw_mean_positions(axes: Axes, cells: Sequence[CellResults]) -> None:
    """Draws the mean position of each cell over time, and the goal."""
    for cell in cells:
        scene = cell.scene or {}
        steps = cell.good_paths
        steps = steps.assign(position=[state[0] for state in steps["state"]])
        mean = steps.groupby("step")["position"].mean()
        sensor = cell.config["system"]["selector"]
        style: Any = {"color": method_look(cell.method).colour, "ls": SENSOR_LINES[sensor]}
        axes.plot(mean.index * scene["dt"], mean, label=f"{cell.name}, {SENSORS[sensor]}", **style)
        axes.axhline(scene["goal"][0], color=GREY, lw=0.6, ls="--")
    title = "(a) mean of the kept trials; dashed: the goal"
    axes.set(title=title, xlabel="time (s)", ylabel="$p_x$ (m)")


def _draw_cost_over_limit(
    axes: Axes, unlimited: Sequence[CellResults], limited: Sequence[CellResults]
) -> None:
    """Draws the cost of Algorithm 1 at each limit, and with the fixed sensor."""
    positions = np.arange(len(limited))
    look = method_look("algorithm_1")
    estimates = [mean_of("cost")(cell) for cell in limited]
    draw_estimates(axes, list(positions), estimates, look, color=look.colour)
    for cell in unlimited:
        is_fixed = cell.method == "algorithm_1" and cell.config["system"]["selector"] == "fixed"
        if is_fixed and len(cell.good):
            cost = mean_of("cost")(cell).value
            axes.axhline(cost, color=INK, lw=0.8, ls=SENSOR_LINES["fixed"])

    limits = [cell.config["system"]["limit"] for cell in limited]
    names = ["none" if limit is None else f"{limit:g}" for limit in limits]
    axes.xaxis.set_major_locator(FixedLocator(list(positions)))
    axes.xaxis.set_major_formatter(FixedFormatter(names))
    axes.xaxis.set_minor_locator(NullLocator())
    title = "(b) Algorithm 1; dotted: with the fixed sensor"
    axes.set(title=title, xlabel="largest signal-to-noise ratio of the sensor", ylabel="cost")
