"""Draws the matching residual along a trial (Proposition 3), and sweeps of horizon and samples."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from .. import published
from ..cell_results import CellResults
from .points import collision_rate, dodge, draw_estimates, mean_of, step_time
from .style import BLUE, COLUMN, GREY, INK, STYLE, Look, drawing_style

READINGS: dict[str, tuple[str, Any]] = {
    "sample": (r"$\sigma_o$ of a sample", {"color": BLUE, "ls": "-"}),
    "intensity": (r"$\sigma_o$ an intensity", {"color": INK, "ls": "-."}),
}
SAMPLES_KEY = "planner.n_samples"
HORIZON_KEY = "planner.horizon"
SHADES = LinearSegmentedColormap.from_list("shades", ["#8CC4E4", BLUE, "#00263D"])


def residual_figure(cell: CellResults) -> Figure | None:
    """Draws the matching residual over time (s) along the recorded trial, by reading of sigma_o.

    Top: epsilon* at the best weight W of each step, with the paper's value (Sec. VII). Bottom,
    where it was recorded: the residual at the imposed weight lambda R^-1, on a log axis. None
    without a recording.
    """
    curves = (cell.recording or {}).get("matching")
    if not curves or cell.scene is None:
        return None
    dt = cell.scene["dt"]
    has_imposed = any("imposed" in curve for curve in curves.values())
    with drawing_style(STYLE):
        figure = Figure(figsize=(COLUMN, 3.3 if has_imposed else 2.0), layout="constrained")
        panels = figure.subplots(1 + has_imposed, 1, sharex=True, squeeze=False)[:, 0]
        _draw_residuals(panels[0], curves, "optimum", dt)
        panels[0].set(ylim=(0, 1.05), ylabel=r"best weight: $\varepsilon^*$")
        if cell.has_paper_settings():
            label = f"paper: {published.RESIDUAL}"
            panels[0].axhline(published.RESIDUAL, color=GREY, lw=0.8, ls="--", label=label)
        if has_imposed:
            _draw_residuals(panels[1], curves, "imposed", dt)
            panels[1].set(yscale="log", ylabel=r"weight $\lambda R^{-1}$: residual")
        panels[-1].set_xlabel("time (s)")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        return figure


def _draw_residuals(axes: Axes, curves: dict[str, Any], weight: str, dt: float) -> None:
    """Draws the residuals at the weight "optimum" or "imposed", one line per reading of sigma_o."""
    for reading, (label, style) in READINGS.items():
        if weight in curves.get(reading, {}):
            residuals = np.array(curves[reading][weight], dtype=float)
            axes.plot(dt * np.arange(len(residuals)), residuals, label=label, **style)


def ess_figure(cells: Sequence[CellResults]) -> Figure | None:
    """Draws four panels against the number of samples N, one line per horizon, with 95 % intervals.

    The panels are effective sample size, collision rate (%), cost, and median ms per step. Cells
    that set neither key are left out. None if no cell remains.
    """
    keys = {SAMPLES_KEY, HORIZON_KEY}
    shown = [cell for cell in cells if len(cell.good) and keys <= cell.labels.keys()]
    if not shown:
        return None
    quantities = {
        "effective sample size": mean_of("ess"),
        "trials that collide (%)": collision_rate,
        "cost": mean_of("cost"),
        "median ms per step": step_time,
    }
    horizons = sorted({cell.labels[HORIZON_KEY] for cell in shown})
    with drawing_style(STYLE):
        figure = Figure(figsize=(COLUMN, 3.4), layout="constrained")
        panels = figure.subplots(2, 2, sharex=True)
        for axes, (title, estimate) in zip(panels.flat, quantities.items(), strict=True):
            axes.set_title(title)
            for index, horizon in enumerate(horizons):
                curve = [cell for cell in shown if cell.labels[HORIZON_KEY] == horizon]
                curve.sort(key=lambda cell: cell.labels[SAMPLES_KEY])
                numbers = [cell.labels[SAMPLES_KEY] for cell in curve]
                x = dodge(numbers, index, len(horizons), ratio=1.12)
                look = _horizon_look(index, len(horizons))
                estimates = [estimate(cell) for cell in curve]
                draw_estimates(axes, x, estimates, look, label=f"$H = {horizon}$")

        panels[0, 0].set_yscale("log")
        panels[0, 0].yaxis.set_major_formatter("{x:g}")
        _label_samples(panels, sorted({cell.labels[SAMPLES_KEY] for cell in shown}))
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
        return figure


def _horizon_look(index: int, count: int) -> Look:
    """Returns the look of one horizon of `count`: longer ones are darker."""
    colour = to_hex(SHADES(index / max(count - 1, 1)))
    return Look(colour, "osD^vPX"[index % 7], ("-", "--", "-.", ":")[index % 4])


def _label_samples(panels: np.ndarray, numbers: Sequence[int]) -> None:
    """Makes the shared axis of samples logarithmic, with ticks at these numbers."""
    panels[0, 0].set_xscale("log")
    panels[0, 0].xaxis.set_major_locator(FixedLocator(list(numbers)))
    panels[0, 0].xaxis.set_minor_locator(NullLocator())
    panels[0, 0].xaxis.set_major_formatter("{x:g}")
    for axes in panels[1]:
        axes.set_xlabel("samples $N$")
