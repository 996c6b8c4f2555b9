"""What goes on inside: the matching residual along a trial (Proposition 3), what samples and horizon buy."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from .. import published
from ..cell_results import CellResults
from .points import collision_rate, dodge, draw_estimates, mean_of, step_time
from .style import BLUE, COLUMN, GREY, INK, STYLE, Look

READINGS: dict[str, tuple[str, Any]] = {
    "sample": (r"$\sigma_o$ of a sample", {"color": BLUE, "ls": "-"}),
    "intensity": (r"$\sigma_o$ an intensity", {"color": INK, "ls": "-."}),
}
SAMPLES, HORIZON = "planner.n_samples", "planner.horizon"
SHADES = LinearSegmentedColormap.from_list("shades", ["#8CC4E4", BLUE, "#00263D"])


def residual_figure(found: CellResults) -> Figure | None:
    """The matching residual along the recorded trial, for both readings of sigma_o, over time in seconds.

    Above, epsilon* at the best weight W of each step, with the paper's value (Sec. VII); below, where it was
    recorded, the residual at the imposed weight lambda R^-1, on a log axis. None without a recording.
    """
    curves = (found.recording or {}).get("matching")
    if not curves or found.scene is None:
        return None
    imposed = any("imposed" in curve for curve in curves.values())
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(COLUMN, 3.3 if imposed else 2.0), layout="constrained")
        panels = figure.subplots(1 + imposed, 1, sharex=True, squeeze=False)[:, 0]
        _curves(panels[0], curves, "optimum", found.scene["dt"])
        panels[0].set(ylim=(0, 1.05), ylabel=r"best weight: $\varepsilon^*$")
        panels[0].axhline(
            published.RESIDUAL, color=GREY, lw=0.8, ls="--", label=f"paper: {published.RESIDUAL}"
        )
        if imposed:
            _curves(panels[1], curves, "imposed", found.scene["dt"])
            panels[1].set(yscale="log", ylabel=r"weight $\lambda R^{-1}$: residual")
        panels[-1].set_xlabel("time (s)")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        return figure


def _curves(axes: Axes, curves: dict[str, Any], which: str, dt: float) -> None:
    for reading, (label, style) in READINGS.items():
        if which in curves.get(reading, {}):
            values = np.array(curves[reading][which], dtype=float)
            axes.plot(dt * np.arange(len(values)), values, label=label, **style)


def ess_figure(founds: Sequence[CellResults]) -> Figure | None:
    """Effective sample size, collision rate (%), cost and median ms per step against the number of samples N.

    A line a horizon, with 95 % intervals; cells that name neither are left out. None if none is left.
    """
    there = [
        found for found in founds if len(found.good) and {SAMPLES, HORIZON} <= found.labels.keys()
    ]
    if not there:
        return None
    quantities = {
        "effective sample size": mean_of("ess"),
        "trials that collide (%)": collision_rate,
        "cost": mean_of("cost"),
        "median ms per step": step_time,
    }
    horizons = sorted({found.labels[HORIZON] for found in there})
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(COLUMN, 3.4), layout="constrained")
        panels = figure.subplots(2, 2, sharex=True)
        for axes, (title, estimate) in zip(panels.flat, quantities.items(), strict=True):
            for index, horizon in enumerate(horizons):
                cells = [found for found in there if found.labels[HORIZON] == horizon]
                cells.sort(key=lambda found: found.labels[SAMPLES])
                x = dodge(
                    [found.labels[SAMPLES] for found in cells], index, len(horizons), ratio=1.12
                )
                label = f"$H = {horizon}$"
                draw_estimates(
                    axes,
                    x,
                    [estimate(found) for found in cells],
                    _shade(index, len(horizons)),
                    label=label,
                )
            axes.set_title(title)
        panels[0, 0].set_yscale("log")
        panels[0, 0].yaxis.set_major_formatter("{x:g}")
        _sample_axis(panels, sorted({found.labels[SAMPLES] for found in there}))
        figure.legend(
            *panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4
        )
        return figure


def _shade(index: int, of: int) -> Look:
    colour = to_hex(SHADES(index / max(of - 1, 1)))
    return Look(colour, "osD^vPX"[index % 7], ("-", "--", "-.", ":")[index % 4])


def _sample_axis(panels: np.ndarray, numbers: Sequence[int]) -> None:
    panels[0, 0].set_xscale("log")
    panels[0, 0].xaxis.set_major_locator(FixedLocator(list(numbers)))
    panels[0, 0].xaxis.set_minor_locator(NullLocator())
    panels[0, 0].xaxis.set_major_formatter("{x:g}")
    for axes in panels[1]:
        axes.set_xlabel("samples $N$")
