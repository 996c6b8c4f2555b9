"""Where paths are sampled: cost and effective sample size against the time of a step."""

from collections.abc import Sequence

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from ..cell_results import METHOD_NAMES, CellResults
from .points import draw_estimates, mean_of, step_time
from .style import COLUMN, STYLE, method_look, method_order

KEY = "controller.proposal"


def proposals_figure(founds: Sequence[CellResults]) -> Figure | None:
    """Cost (left) and effective sample size (right) against ms per step, with 95 % intervals.

    A line a method and proposal through its numbers of samples: full marks and lines for the Laplace proposal, hollow
    and dotted for the nominal. None without times.
    """
    there = [found for found in founds if len(found.good) and found.seconds and KEY in found.labels]
    if not there:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(2 * COLUMN, 2.5), layout="constrained")
        panels = figure.subplots(1, 2)
        for method in sorted({found.method for found in there}, key=method_order):
            for proposal, more in {
                "laplace": {"ls": "-"},
                "nominal": {"ls": ":", "mfc": "white"},
            }.items():
                cells = [
                    one for one in there if (one.method, one.labels[KEY]) == (method, proposal)
                ]
                cells.sort(key=lambda one: one.samples or 0)
                times = [step_time(one).value for one in cells]
                for axes, column in zip(panels, ("cost", "ess"), strict=True):
                    label = f"{METHOD_NAMES.get(method, method)}, {proposal}"
                    draw_estimates(
                        axes,
                        times,
                        [mean_of(column)(one) for one in cells],
                        method_look(method),
                        label=label,
                        **more,
                    )
                for time, one in zip(times, cells, strict=True):
                    at, below = (time, mean_of("cost")(one).value), proposal == "laplace"
                    panels[0].annotate(
                        str(one.samples),
                        at,
                        (0, -9 if below else 4),
                        textcoords="offset points",
                        size=6,
                        ha="center",
                    )
        panels[0].set(xscale="log", yscale="log", ylabel="cost", xlabel="ms per step")
        panels[0].yaxis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)))
        panels[0].yaxis.set_major_formatter("{x:g}")
        panels[0].yaxis.set_minor_formatter(NullFormatter())
        panels[0].margins(y=0.12)
        panels[1].set(
            xscale="log", yscale="log", ylabel="effective sample size", xlabel="ms per step"
        )
        for axes in panels:
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.xaxis.set_major_formatter("{x:g}")
            axes.xaxis.set_minor_formatter(NullFormatter())
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
        return figure
