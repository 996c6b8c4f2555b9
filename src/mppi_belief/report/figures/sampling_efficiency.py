"""Draws cost and effective sample size against time per step, by the policy that samples."""

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.ticker import LogLocator, NullFormatter

from ..cell_results import METHOD_NAMES, CellResults
from .point_labels import place_labels
from .points import draw_estimates, mean_of, step_time
from .style import COLUMN, STYLE, drawing_style, method_look, method_order

PROPOSAL_KEY = "sampler"
PROPOSAL_STYLES: dict[str, Any] = {"laplace": {"ls": "-"}, "nominal": {"ls": ":", "mfc": "white"}}


def proposals_figure(cells: Sequence[CellResults]) -> Figure | None:
    """Draws cost (left) and effective sample size (right) against ms per step, with 95 % intervals.

    One line per method and proposal runs through its numbers of samples, with full marks for the
    Laplace proposal and hollow, dotted ones for the nominal. None without times.
    """
    shown = [cell for cell in cells if len(cell.good) and cell.seconds]
    shown = [cell for cell in shown if PROPOSAL_KEY in cell.labels]
    if not shown:
        return None
    with drawing_style(STYLE):
        figure = Figure(figsize=(2 * COLUMN, 2.9), layout="constrained")
        panels = figure.subplots(1, 2)
        marks: list[Annotation] = []
        for method in sorted({cell.method for cell in shown}, key=method_order):
            for proposal in PROPOSAL_STYLES:
                key = (method, proposal)
                curve = [cell for cell in shown if (cell.method, cell.labels[PROPOSAL_KEY]) == key]
                marks += _draw_proposal(panels, sorted(curve, key=_samples), method, proposal)
        _label_proposal_axes(panels)
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
        place_labels(figure, marks)
        return figure


def _samples(cell: CellResults) -> int:
    return cell.samples or 0


def _draw_proposal(
    panels: Sequence[Axes], curve: Sequence[CellResults], method: str, proposal: str
) -> list[Annotation]:
    """Draws the cells of one method and proposal in both panels.

    Returns the numbers of samples as labels of the points on the left, still to be placed.
    """
    times = [step_time(cell).value for cell in curve]
    label = f"{METHOD_NAMES.get(method, method)}, {proposal}"
    for axes, column in zip(panels, ("cost", "ess"), strict=True):
        estimates = [mean_of(column)(cell) for cell in curve]
        style = PROPOSAL_STYLES[proposal]
        draw_estimates(axes, times, estimates, method_look(method), label=label, **style)

    label_style: Any = {"textcoords": "offset points", "color": method_look(method).colour}
    return [
        panels[0].annotate(
            str(cell.samples), (time, mean_of("cost")(cell).value), (0, 0), **label_style
        )
        for time, cell in zip(times, curve, strict=True)
    ]


def _label_proposal_axes(panels: Sequence[Axes]) -> None:
    """Labels the axes, all logarithmic with plain numbers."""
    panels[0].set(xscale="log", yscale="log", ylabel="cost", xlabel="ms per step")
    panels[0].yaxis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)))
    panels[0].yaxis.set_major_formatter("{x:g}")
    panels[0].yaxis.set_minor_formatter(NullFormatter())
    panels[0].margins(y=0.12)
    panels[1].set(xscale="log", yscale="log", ylabel="effective sample size", xlabel="ms per step")
    for axes in panels:
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
