"""Table I with ten times the paper's trials, for the methods whose trials are quick."""

import math
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from .. import published
from ..agreement import compare_numbers
from ..cell_results import CellResults, Studies
from ..elements import write_page_table
from ..page import Section
from ..summary import interval_text, summarise_trials
from ..wording import count_range

STUDY = "table_1_long"


def table_1_long_section(studies: Studies, folder: Path) -> Section:
    """Builds the section: costs, spreads and collision rates with their z."""
    cells = studies[STUDY]
    caption = "Table I over more trials"
    return Section(
        f"Table I over {count_range(len(cell.good) for cell in cells)} trials",
        [
            "The trials continue those of Table I on the same seed. z compares with the paper's "
            f"{published.PAPER_TRIALS} trials."
        ],
        [write_page_table(folder, STUDY, caption, long_frame(cells), cells)],
    )


def long_frame(cells: Sequence[CellResults]) -> pd.DataFrame:
    """Returns a line of text per cell."""
    return pd.DataFrame([_long_line(cell) for cell in cells])


def _long_line(cell: CellResults) -> dict[str, str]:
    """Returns the line of one cell; z only where the settings are the paper's."""
    ours = summarise_trials(cell.rows, None)
    z = [f"{number.z:+.1f}" for number in compare_numbers([cell], [], [])]
    return {
        "Method": cell.name,
        "Trials": str(ours.good),
        "Cost [95 %]": interval_text(ours.cost, 1),
        "Spread": "-" if math.isnan(ours.sd) else f"{ours.sd:.1f}",
        "Collision % [95 %]": interval_text(ours.collided.times(100), 1),
        "z of cost, spread, collisions": ", ".join(z) or "-",
    }
