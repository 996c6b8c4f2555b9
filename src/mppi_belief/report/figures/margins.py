"""Draws collisions, clearance and cost of three planners over the setting that each is tuned by."""

from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..cell_results import CellResults
from ..margin_planners import (
    CHANCE,
    DEVIATIONS,
    EXACT_MOMENTS,
    SETTINGS,
    SIGMA_POINTS,
    THETA,
    WEIGHT,
    cells_by_planner,
    setting_of,
    swept_cells,
)
from .points import collision_rate, dodge, draw_estimates, mean_of
from .style import BLUE, COLUMN, GREEN, STYLE, Look, drawing_style, method_look

PLANNER_LOOKS = {
    SIGMA_POINTS: Look(BLUE, "o", "-"),
    EXACT_MOMENTS: Look(GREEN, "^", "-."),
    CHANCE: method_look("chance"),
}
SETTING_AXES = {
    THETA: r"risk aversion $\theta$",
    WEIGHT: r"obstacle weight $w_\mathrm{obs}$ (1/s)",
    DEVIATIONS: r"standard deviations ($\sqrt{c}$ or $k$)",
}
QUANTITIES = {
    "trials that collide (%)": collision_rate,
    "clearance (m)": mean_of("clearance"),
    "cost": mean_of("cost"),
}


def margins_figure(cells: Sequence[CellResults]) -> Figure | None:
    """Draws a row per quantity and a column per swept setting, with 95 % intervals.

    A planner is absent from the columns of settings that it does not have. None without a sweep.
    """
    groups = cells_by_planner(cells)
    swept = {
        name: {planner: swept_cells(group, name) for planner, group in groups.items()}
        for name in SETTINGS
    }
    columns = [name for name in SETTINGS if any(swept[name].values())]
    if not columns:
        return None
    with drawing_style(STYLE):
        figure = Figure(figsize=(2 * COLUMN, 4.8), layout="constrained")
        panels = figure.subplots(3, len(columns), sharex="col", sharey="row", squeeze=False)
        for column, name in zip(panels.T, columns, strict=True):
            for axes, estimate in zip(column, QUANTITIES.values(), strict=True):
                for index, (planner, curve) in enumerate(swept[name].items()):
                    x = [setting_of(cell, name) for cell in curve]
                    if name != DEVIATIONS:
                        axes.set_xscale("log")
                        x = dodge(x, index, len(groups), ratio=1.1)
                    estimates = [estimate(cell) for cell in curve]
                    draw_estimates(axes, x, estimates, PLANNER_LOOKS[planner])
            column[-1].set_xlabel(SETTING_AXES[name])
        for axes, title in zip(panels[:, 0], QUANTITIES, strict=True):
            axes.set_ylabel(title)
        looks = [PLANNER_LOOKS[planner] for planner in groups]
        marks = [Line2D([], [], c=look.colour, marker=look.marker, ls=look.line) for look in looks]
        figure.legend(marks, list(groups), loc="outside lower center", ncols=3)
        return figure
