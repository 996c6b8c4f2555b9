"""What a sensor that is chosen to match does to Algorithm 1: where it brings the system, and what a limit costs."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, NullLocator

from ..cell_results import CellResults
from .points import draw_estimates, mean_of
from .style import COLUMN, GREY, INK, STYLE, method_look

STYLES = {"matched": "-", "fixed": (0, (1, 1))}
SENSORS = {"matched": "sensor chosen", "fixed": "sensor fixed"}


def sensing_figure(chosen: Sequence[CellResults], limited: Sequence[CellResults]) -> Figure | None:
    """(a) mean first coordinate (m) of the kept trials over time (s), a line a method and sensor; (b) mean cost of
    Algorithm 1 against the limit of its sensor, with 95 % intervals. `limited` in rising order of the limit, which is
    "system.limit" of their configurations, infinite for None. None where nothing was kept.
    """
    kept = [found for found in chosen if not found.paths.empty and found.scene is not None]
    if not kept:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(COLUMN, 3.9), layout="constrained")
        panels = figure.subplots(2, 1)
        _over_time(panels[0], kept)
        _over_limit(panels[1], chosen, [found for found in limited if len(found.good)])
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2)
        return figure


def _over_time(axes: Axes, kept: Sequence[CellResults]) -> None:
    for found in kept:
        scene, paths = (
            found.scene or {},
            found.paths[found.paths["trial"].isin(found.good["trial"])],
        )
        place = (
            paths.assign(place=[state[0] for state in paths["state"]])
            .groupby("step")["place"]
            .mean()
        )
        selector = found.cell.config["system"]["selector"]
        style: Any = {"color": method_look(found.method).colour, "ls": STYLES[selector]}
        axes.plot(
            place.index * scene["dt"], place, label=f"{found.name}, {SENSORS[selector]}", **style
        )
        axes.axhline(scene["goal"][0], color=GREY, lw=0.6, ls="--")
    axes.set(
        title="(a) mean of the kept trials, goal dashed", xlabel="time (s)", ylabel="$p_x$ (m)"
    )


def _over_limit(axes: Axes, chosen: Sequence[CellResults], limited: Sequence[CellResults]) -> None:
    places = np.arange(len(limited))
    method = method_look("algorithm_1")
    draw_estimates(
        axes,
        list(places),
        [mean_of("cost")(found) for found in limited],
        method,
        color=method.colour,
    )
    for found in chosen:
        if (
            found.method == "algorithm_1"
            and found.cell.config["system"]["selector"] == "fixed"
            and len(found.good)
        ):
            axes.axhline(mean_of("cost")(found).value, color=INK, lw=0.8, ls=STYLES["fixed"])
    limits = [found.cell.config["system"]["limit"] for found in limited]
    axes.xaxis.set_major_locator(FixedLocator(list(places)))
    axes.xaxis.set_major_formatter(
        FixedFormatter(["none" if limit is None else f"{limit:g}" for limit in limits])
    )
    axes.xaxis.set_minor_locator(NullLocator())
    title = "(b) Algorithm 1; dotted: the fixed sensor"
    axes.set(title=title, xlabel="largest signal-to-noise ratio of the sensor", ylabel="cost")
