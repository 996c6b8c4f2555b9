"""Compares cells trial by trial, over the trials that both have; these meet the same noise."""

import math
from collections.abc import Sequence

import pandas as pd

from .cell_results import CellResults, cell_titles, paired_rows
from .statistics import Estimate, paired_mean_difference, paired_rate_difference
from .summary import interval_text


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
    lines = []
    for index, cell in enumerate(cells):
        if not references or index == references[0]:
            continue
        reference_cell = cells[references[0]]
        pairs, _ = paired_rows(reference_cell, cell)
        rate, p_value = collision_difference(reference_cell, cell)
        line = {
            "Difference": f"{titles[references[0]]} - {titles[index]}",
            "Pairs": str(len(pairs)),
            "Cost [95 %]": interval_text(cost_difference(reference_cell, cell), 2),
            "Collisions, points [95 %]": interval_text(rate.times(100), 1),
            "McNemar p": "-" if math.isnan(p_value) else f"{p_value:.2g}",
        }
        lines.append(line)
    return pd.DataFrame(lines)
