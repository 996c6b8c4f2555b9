"""Quality per time: what a method's setting takes of time, and what it buys in cost and collisions."""

import math
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import pandas as pd

from .. import figures
from ..cell_results import CellResults, by_method, differing_labels, paired_rows
from ..elements import cost_text, write_picture, write_table
from ..figures.style import method_order
from ..page import Section
from ..statistics import Estimate, paired_mean_difference, paired_rate_difference
from ..summary import interval_text, summarise_trials, summary_text

ABOVE = "above best [95 %]"
SHOWN = (
    "method",
    "setting",
    "samples",
    "ms/step (p95)",
    "cost [95 %]",
    ABOVE,
    "collided % [95 %]",
    "ESS",
    "trials",
)
ENOUGH = 0.05  # of the least cost; a choice


def quality(founds: list[CellResults], folder: Path) -> Section:
    """The table and figure of all settings, and for each method the quickest that is good enough."""
    there = by_method(founds)
    methods = [there[method] for method in sorted(there, key=method_order)]
    alt = "Cost and collision rate against milliseconds per step and against sampled paths per step, a line a method"
    return Section(
        "Quality per time: which setting to choose",
        [
            "Settings of a method are compared trial by trial, since all met the same noise. "
            f"One is good enough here if it costs for certain less than {100 * ENOUGH:g} % more than the best: "
            "where the 95 % interval of the difference ends below that."
            f"{_real_time(founds)}",
            *(
                f"{advice(cells)}. {collisions(cells)}."
                for cells in methods
                if any(len(one.good) for one in cells)
            ),
        ],
        [
            write_table(
                folder,
                "quality_per_time",
                "Every setting of every method",
                lines(methods),
                [*chain(*methods)],
            )
        ],
        write_picture(folder, "quality_per_time", figures.quality_figure(founds), alt),
    )


def lines(methods: Sequence[Sequence[CellResults]]) -> pd.DataFrame:
    """A line a cell: the method, what of it was set, sampled paths a step, what that takes and buys."""
    text = []
    for cells in methods:
        best = _best(cells)
        for found, setting in zip(cells, settings(cells), strict=True):
            line = summary_text(
                found.rows, {"method": found.name, "setting": setting or "-"}, found.seconds
            )
            line["samples"] = str(found.samples or "-")
            line[ABOVE] = "-" if found is best else interval_text(_above(found, best), 2)
            text.append({name: line.get(name, "-") for name in SHOWN})
    return pd.DataFrame(text)


def settings(cells: Sequence[CellResults]) -> list[str]:
    """What tells the cells of one method apart, as a command line says it."""
    return [
        " ".join(f"{name}={value}" for name, value in one.items() if value != "-")
        for one in differing_labels(cells)
    ]


def advice(cells: Sequence[CellResults]) -> str:
    """The best setting of one method and, where all were timed, the quickest that is good enough; some trial went well.

    A setting of which more trials failed than of another is never recommended.
    """
    told = {
        found.cell.id: _told(found, setting)
        for found, setting in zip(cells, settings(cells), strict=True)
    }
    cells = _sound(cells)
    best = _best(cells)
    bound = ENOUGH * summarise_trials(best.rows, None).cost.value
    if not _timed(cells):
        return f"{best.name}: the best is {told[best.cell.id]}, and not all settings were timed"
    quickest = next(
        found for found in _by_time(cells) if found is best or _above(found, best).high <= bound
    )
    if quickest is best:
        lead = (
            "no setting quicker than the best is shown to be good enough: "
            if len(cells) > 1
            else ""
        )
        return f"{best.name}: {lead}{told[best.cell.id]}"
    more, chosen = interval_text(_above(quickest, best), 2), told[quickest.cell.id]
    return f"{best.name}: the quickest that is good enough is {chosen}, {more} above the best, {told[best.cell.id]}"


def collisions(cells: Sequence[CellResults]) -> str:
    """How often one method collides, and what the slowest setting changes about it; some trial of it went well."""
    there = _by_time([found for found in cells if len(found.good)])
    rates = [summarise_trials(found.rows, None).collided.times(100) for found in there]
    if len(there) == 1:
        return f"Collisions: {interval_text(rates[0], 1)} %"
    quick, slow = paired_rows(there[0], there[-1])
    change, _ = paired_rate_difference(slow["collided"].to_numpy(), quick["collided"].to_numpy())
    low, high = min(rates).value, max(rates).value
    ends = (
        "the quickest setting to the slowest" if _timed(there) else "the first setting to the last"
    )
    told = f"from {ends} they change by {interval_text(change.times(100), 1)} points"
    return f"Collisions: {low:.1f} to {high:.1f} %; {told}"


def _best(cells: Sequence[CellResults]) -> CellResults:
    """The cell of least mean cost, of those that have one."""
    costs = [summarise_trials(found.rows, None).cost.value for found in cells]
    return cells[
        min(
            range(len(cells)),
            key=lambda index: math.inf if math.isnan(costs[index]) else costs[index],
        )
    ]


def _sound(cells: Sequence[CellResults]) -> list[CellResults]:
    """The cells of which the smallest part of the trials failed."""
    failed = [
        1 - len(found.good) / len(found.rows) if len(found.rows) else math.inf for found in cells
    ]
    return [found for found, part in zip(cells, failed, strict=True) if part == min(failed)]


def _timed(cells: Sequence[CellResults]) -> bool:
    return not any(math.isnan(summarise_trials(found.rows, found.seconds).time) for found in cells)


def _by_time(cells: Sequence[CellResults]) -> list[CellResults]:
    """The quickest first; as they are given where one was not timed."""
    if not _timed(cells):
        return list(cells)
    return sorted(cells, key=lambda found: summarise_trials(found.rows, found.seconds).time)


def _above(found: CellResults, best: CellResults) -> Estimate:
    one, other = paired_rows(found, best)
    return paired_mean_difference(one["cost"].to_numpy(), other["cost"].to_numpy())


def _told(found: CellResults, setting: str) -> str:
    """A setting with its cost and, where it was taken, its time."""
    time = summarise_trials(found.rows, found.seconds).time
    numbers = f"cost {cost_text(found)}" + ("" if math.isnan(time) else f", {time:.2f} ms a step")
    return f"`{setting}` ({numbers})" if setting else numbers


def _real_time(founds: Sequence[CellResults]) -> str:
    """How the slowest setting compares with the time that a step of the system lasts."""
    steps = {found.cell.config["problem"].get("dt") for found in founds}
    slow = [
        summarise_trials(found.rows, found.seconds).time_p95 for found in founds if found.seconds
    ]
    if len(steps) != 1 or None in steps or not slow:
        return ""
    return f" A step of the system lasts {1e3 * steps.pop():g} ms; the slowest setting takes {max(slow):.1f} ms (p95)."
