"""Compares cells trial by trial, over the trials that both have; these meet the same noise."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import pandas as pd

from ..errors import counted
from .cell_results import CellResults, cell_titles, paired_rows
from .statistics import Estimate, holm_adjusted, paired_mean_difference, paired_rate_difference
from .summary import interval_text, label_text

P_COLUMN = "McNemar p (Holm)"  # of collisions, adjusted for all lines of a table


class CellPair(NamedTuple):
    """Holds two cells that are compared trial by trial, with their names in the table."""

    first: CellResults
    second: CellResults
    title: str  # of the difference, "FIRST - SECOND"


def cost_difference(first: CellResults, second: CellResults) -> Estimate:
    """Returns the mean of the cost of first minus that of second (BCa bootstrap interval)."""
    first_rows, second_rows = paired_rows(first, second)
    return paired_mean_difference(first_rows["cost"].to_numpy(), second_rows["cost"].to_numpy())


def collision_difference(first: CellResults, second: CellResults) -> tuple[Estimate, float]:
    """Returns the collision rate of first minus that of second, and McNemar's exact p-value."""
    first_rows, second_rows = paired_rows(first, second)
    return paired_rate_difference(
        first_rows["collided"].to_numpy(bool), second_rows["collided"].to_numpy(bool)
    )


def method_differences(cells: Sequence[CellResults], reference: str = "belief") -> pd.DataFrame:
    """Returns a line of text per cell: the first cell of the method `reference` minus this cell.

    The frame is empty where no cell has that method.
    """
    titles = cell_titles(cells)
    references = [index for index, cell in enumerate(cells) if cell.method == reference]
    if not references:
        return pd.DataFrame()
    first = references[0]
    pairs = [
        CellPair(cells[first], cell, f"{titles[first]} - {titles[index]}")
        for index, cell in enumerate(cells)
        if index != first
    ]
    return difference_frame(pairs)


def baseline_pairs(cells: Sequence[CellResults]) -> list[CellPair]:
    """Pairs each cell with its baseline: the cell minus the baseline, over common random numbers.

    The baseline is the first cell before it that differs in the controller alone, or else the first
    cell of the study. Only cells of one system and one seed meet the same noise; others are not
    compared, so the first cell of each system and seed has no baseline.
    """
    titles = cell_titles(cells)
    pairs = []
    for index, cell in enumerate(cells):
        earlier = [
            position
            for position in range(index)
            if cells[position].system == cell.system
            and cells[position].config["seed"] == cell.config["seed"]
        ]
        if not earlier:
            continue
        alike = [position for position in earlier if _differ_in_method(cells[position], cell)]
        baseline = (alike or earlier)[0]
        title = f"{titles[index]} - {titles[baseline]}"
        pairs.append(CellPair(cell, cells[baseline], title))
    return pairs


def _differ_in_method(first: CellResults, second: CellResults) -> bool:
    """Returns whether two cells differ in the controller, and in no other label that both have."""
    if first.method == second.method:
        return False
    texts = [
        {key: label_text(value) for key, value in cell.labels.items()} for cell in (first, second)
    ]
    common = (texts[0].keys() & texts[1].keys()) - {"controller"}
    values = [(texts[0][key], texts[1][key]) for key in common]
    return all(a == b or "-" in (a, b) for a, b in values)


def difference_frame(pairs: Sequence[CellPair]) -> pd.DataFrame:
    """Returns a line of text per pair of cells; the p-values are adjusted for all of them."""
    compared = [collision_difference(pair.first, pair.second) for pair in pairs]
    adjusted = holm_adjusted([p_value for _, p_value in compared])
    lines = []
    for pair, (rate, _), p_value in zip(pairs, compared, adjusted, strict=True):
        rows, _ = paired_rows(pair.first, pair.second)
        line = {
            "Difference": pair.title,
            "Pairs": str(len(rows)),
            "Cost [95 %]": interval_text(cost_difference(pair.first, pair.second), 2),
            "Collisions, points [95 %]": interval_text(rate.times(100), 1),
            P_COLUMN: "-" if math.isnan(p_value) else f"{p_value:.2g}",
        }
        lines.append(line)
    return pd.DataFrame(lines)


def multiplicity_text(frame: pd.DataFrame) -> str:
    """Says for the caption of a table of differences what its intervals and p-values cover."""
    number = int((frame[P_COLUMN] != "-").sum()) if P_COLUMN in frame else len(frame)
    text = "each interval is at 95 % by itself"
    if number and P_COLUMN in frame:
        text += f"; McNemar's exact p is adjusted by Holm's method for {counted(number, 'test')}"
    return text
