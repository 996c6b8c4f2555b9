"""Quality per time: time of a step, cost and collisions with each setting of each method."""

import math
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import pandas as pd

from ..cell_results import CellResults, by_method, differing_labels
from ..comparison import collision_difference, cost_difference
from ..elements import cost_text, write_page_table, write_picture
from ..figures.quality import quality_figure
from ..figures.style import method_order
from ..page import Section
from ..summary import interval_text, summarise_trials, summary_text

ABOVE = "above best [95 %]"
QUALITY_COLUMNS = (
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
GOOD_ENOUGH = 0.05  # of the lowest cost; a setting within it counts as good enough; a choice


def quality_per_time_section(cells: list[CellResults], folder: Path) -> Section:
    """Builds the section: all settings, and for each method the quickest that is good enough."""
    methods = by_method(cells)
    groups = [methods[method] for method in sorted(methods, key=method_order)]
    stem = "quality_per_time"
    caption = "Every setting of every method"
    alt = (
        "Cost and collision rate against milliseconds per step and against sampled paths per step; "
        "one line per method"
    )
    verdicts = [
        f"{advice(group)}. {collision_range(group)}."
        for group in groups
        if any(len(cell.good) for cell in group)
    ]
    return Section(
        "Quality per time: which setting to choose",
        [
            "The settings of a method are compared trial by trial, since all met the same noise. A "
            f"setting is good enough here if the 95 % interval of its cost above the best setting "
            f"ends below {100 * GOOD_ENOUGH:g} % of the best cost.{_real_time(cells)}",
            *verdicts,
        ],
        [write_page_table(folder, stem, caption, quality_frame(groups), [*chain(*groups)])],
        write_picture(folder, stem, lambda: quality_figure(cells), alt),
    )


def quality_frame(groups: Sequence[Sequence[CellResults]]) -> pd.DataFrame:
    """Returns a line of text per cell; each group holds the cells of one method."""
    lines = []
    for group in groups:
        best = _best(group)
        for cell, setting in zip(group, setting_texts(group), strict=True):
            labels = {"method": cell.name, "setting": setting or "-"}
            line = summary_text(cell.rows, labels, cell.seconds, cell.busy)
            line["samples"] = str(cell.samples or "-")
            line[ABOVE] = "-" if cell is best else interval_text(cost_difference(cell, best), 2)
            lines.append({name: line.get(name, "-") for name in QUALITY_COLUMNS})
    return pd.DataFrame(lines)


def setting_texts(cells: Sequence[CellResults]) -> list[str]:
    """Returns the settings in which the cells of one method differ, as on the command line."""
    return [
        " ".join(f"{name}={value}" for name, value in labels.items() if value != "-")
        for labels in differing_labels(cells)
    ]


def advice(cells: Sequence[CellResults]) -> str:
    """Names the best setting of one method and the quickest one that is good enough.

    At least one trial must have succeeded. The quickest setting is named only where all were timed.
    A setting of which more trials failed than of another is never recommended.
    """
    settings = zip(cells, setting_texts(cells), strict=True)
    descriptions = {cell.id: _describe(cell, setting) for cell, setting in settings}
    sound = _soundest(cells)
    best = _best(sound)
    best_text = descriptions[best.id]
    if not _all_timed(sound):
        return f"{best.name}: the best is {best_text}, and not all settings were timed"

    # The best cell itself ends the search at the latest.
    bound = GOOD_ENOUGH * summarise_trials(best.rows, None).cost.value
    quickest = next(
        cell
        for cell in _by_time(sound)
        if cell is best or cost_difference(cell, best).high <= bound
    )
    if quickest is not best:
        above = interval_text(cost_difference(quickest, best), 2)
        return (
            f"{best.name}: the quickest setting that is good enough is "
            f"{descriptions[quickest.cell.id]}, {above} above the best, {best_text}"
        )
    if len(sound) == 1:
        return f"{best.name}: {best_text}"
    return f"{best.name}: no setting quicker than the best is shown to be good enough: {best_text}"


def collision_range(cells: Sequence[CellResults]) -> str:
    """Says how often one method collides, and by how much the slowest setting changes it.

    At least one trial must have succeeded.
    """
    ordered = _by_time([cell for cell in cells if len(cell.good)])
    rates = [summarise_trials(cell.rows, None).collided.times(100) for cell in ordered]
    if len(ordered) == 1:
        return f"Collisions: {interval_text(rates[0], 1)} %"
    change, _ = collision_difference(ordered[-1], ordered[0])
    ends = "the first setting to the last"
    if _all_timed(ordered):
        ends = "the quickest setting to the slowest"
    return (
        f"Collisions: {min(rates).value:.1f} to {max(rates).value:.1f} %; from {ends} they change "
        f"by {interval_text(change.times(100), 1)} points"
    )


def _best(cells: Sequence[CellResults]) -> CellResults:
    """Returns the first cell of lowest mean cost, among those that have one."""

    def cost(cell: CellResults) -> float:
        value = summarise_trials(cell.rows, None).cost.value
        return math.inf if math.isnan(value) else value

    return min(cells, key=cost)


def _soundest(cells: Sequence[CellResults]) -> list[CellResults]:
    """Returns the cells of which the smallest part of the trials failed."""
    failed = [1 - len(cell.good) / len(cell.rows) if len(cell.rows) else math.inf for cell in cells]
    return [cell for cell, part in zip(cells, failed, strict=True) if part == min(failed)]


def _step_time(cell: CellResults) -> float:
    """Returns the median time of a control step in ms, NaN where none was measured."""
    return summarise_trials(cell.rows, cell.seconds).time


def _all_timed(cells: Sequence[CellResults]) -> bool:
    return not any(math.isnan(_step_time(cell)) for cell in cells)


def _by_time(cells: Sequence[CellResults]) -> list[CellResults]:
    """Sorts the cells by their time; keeps their order where one was not timed."""
    return sorted(cells, key=_step_time) if _all_timed(cells) else list(cells)


def _describe(cell: CellResults, setting: str) -> str:
    """Returns a setting with its cost and, where it was measured, its time."""
    time = _step_time(cell)
    numbers = f"cost {cost_text(cell)}"
    if not math.isnan(time):
        numbers += f", {time:.2f} ms per step"
    return f"`{setting}` ({numbers})" if setting else numbers


def _real_time(cells: Sequence[CellResults]) -> str:
    """Compares the slowest setting with the time step of the system."""
    steps = {cell.config["problem"].get("dt") for cell in cells}
    times = [summarise_trials(cell.rows, cell.seconds).time_p95 for cell in cells if cell.seconds]
    if len(steps) != 1 or None in steps or not times:
        return ""
    return (
        f" A time step of the system lasts {1e3 * steps.pop():g} ms; a control step of the slowest "
        f"setting takes {max(times):.1f} ms (95th percentile)."
    )
