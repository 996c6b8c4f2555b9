"""Horizon and number of samples of MPPI-Belief: cost, collisions, effective sample size, time."""

from pathlib import Path

from .. import published
from ..cell_results import CellResults
from ..elements import cell_lines, collision_text, cost_text, write_page_table, write_picture
from ..figures.diagnostics import HORIZON_KEY, SAMPLES_KEY, ess_figure
from ..page import Section


def horizon_and_samples_section(cells: list[CellResults], folder: Path) -> Section:
    """Builds the section: collisions and cost at the paper's horizon, the table, the figure."""
    results = [
        f"{collision_text(cell)} and {cost_text(cell)} with N = {cell.labels[SAMPLES_KEY]}"
        for cell in cells
        if cell.labels.get(HORIZON_KEY) == published.PAPER_HORIZON and len(cell.good)
    ]
    horizon = f"At the paper's horizon of {published.PAPER_HORIZON} steps"
    text = [f"{horizon}, collisions and cost are {'; '.join(results)}."] if results else []
    stem = "horizon_and_samples"
    caption = "MPPI-Belief by horizon and samples"
    alt = "Effective sample size, collision rate, cost and time by number of samples and horizon"
    return Section(
        "Horizon and number of samples",
        text,
        [write_page_table(folder, stem, caption, cell_lines(cells), cells)],
        write_picture(folder, stem, lambda: ess_figure(cells), alt),
    )
