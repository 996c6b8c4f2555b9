"""The row theta = 0 of Sec. VII: exact expectation (3) of the penalty, or its value at the mean."""

from pathlib import Path

from .. import published
from ..cell_results import CellResults
from ..elements import cell_lines, collision_text, write_page_table
from ..page import Section

EXPECTATIONS = {
    "exact": "with the exact expectation of the penalty",
    "at_mean": "with the penalty at the mean",
}


def expectation_section(cells: list[CellResults], folder: Path) -> Section:
    """Builds the section: collisions at theta = 0 with both expectations, and the table."""
    neutral = [cell for cell in cells if cell.labels["theta"] == 0 and len(cell.good)]
    rates = [
        f"{collision_text(cell)} {EXPECTATIONS[cell.labels[published.EXPECTATION_KEY]]}"
        for cell in neutral
    ]
    varied = (published.THETA_KEY, published.EXPECTATION_KEY)
    paper = ""
    if neutral and all(cell.has_paper_settings(*varied) for cell in neutral):
        paper = f"; the paper has {100 * published.PAPER_THETA[0.0].collision_rate[0]:g} %"
    result = f"Trials that collide at theta = 0: {', '.join(rates)}{paper}." if rates else ""
    caption = "MPPI-Belief by expectation and risk aversion"
    return Section(
        "What theta = 0 means",
        [
            "With the exact expectation of the obstacle penalty, a planner without risk aversion "
            "already accounts for the covariance. With the penalty at the mean, that planner is "
            "CE-MPPI, path by path, and theta adds nothing but the variance. "
            f"{result}".rstrip()
        ],
        [write_page_table(folder, "expectation", caption, cell_lines(cells), cells)],
    )
