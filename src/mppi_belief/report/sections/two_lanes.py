"""Beyond the paper: a start in one of two lanes, believed as a mixture or as one Gaussian."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..cell_results import CellResults, cell_titles
from ..elements import cell_lines, collision_text, write_page_table, write_path_panels
from ..page import Section
from ..statistics import Estimate, proportion_interval
from ..summary import interval_text

ARRIVAL_RADIUS = 1.0  # m; a trial that ends this near the goal counts as arrived; a choice


def two_lanes_section(cells: list[CellResults], folder: Path) -> Section:
    """Builds the section: all cells with the part that arrives, and the paths with both filters."""
    arrived = [interval_text(arrival_rate(cell).times(100), 1) for cell in cells]
    frame = cell_lines(cells)
    columns = list(frame.columns)
    frame.insert(columns.index("collided % [95 %]") + 1, "arrived % [95 %]", arrived)
    frame.insert(columns.index("trials"), "planned from", [_planned_from(cell) for cell in cells])
    results = [
        f"{title} collides in {collision_text(cell)} of the trials and arrives in {rate} %."
        for title, cell, rate in zip(_sentence_titles(cells), cells, arrived, strict=True)
        if len(cell.good)
    ]
    shown = filter_cells(cells)
    titles = [f"{cell.name}, filter={cell.labels['filter']}" for cell in shown]
    paths = "Paths in the plane, a panel per method and filter"
    return Section(
        "Beyond the paper: a belief with two modes",
        [
            "The vehicle starts in one of two lanes, does not know in which, and can hardly "
            "measure it from there. One obstacle stands between the lanes and one beside each; "
            "both lanes are free. One Gaussian with the mean and covariance of the two has its "
            "mean in front of the middle obstacle. With `filter=mixture` each lane is a Gaussian "
            "of its own, and the planner plans from both. A trial counts as arrived if it ends "
            f"within {ARRIVAL_RADIUS:g} m of the goal.",
            " ".join(results),
        ],
        [write_page_table(folder, "two_lanes", "Every filter and planner", frame, cells)],
        write_path_panels(folder, "two_lanes", shown, titles, paths),
    )


def _sentence_titles(cells: Sequence[CellResults]) -> list[str]:
    """Names the cells; those that plan from the moments of the mixture are marked as such."""
    titles = []
    for title, cell in zip(cell_titles(cells), cells, strict=True):
        titles.append(f"{title}, from moments," if _planned_from(cell) == "moments" else title)
    return titles


def _planned_from(cell: CellResults) -> str:
    """Returns what MPPI-Belief plans from, where the study sets it; "-" elsewhere."""
    return str(cell.labels.get("schedule", "-"))


def arrival_rate(cell: CellResults) -> Estimate:
    """Returns the part of the good trials that end near the goal."""
    arrived = np.asarray(cell.good["final_distance"] < ARRIVAL_RADIUS)
    return proportion_interval(int(arrived.sum()), len(arrived))


def filter_cells(cells: Sequence[CellResults]) -> list[CellResults]:
    """Returns MPPI-Belief at the largest theta of the study and CE-MPPI, each with both filters."""
    candidates = [cell for cell in cells if "filter" in cell.labels and _planned_from(cell) == "-"]
    thetas = [cell.labels["theta"] for cell in candidates if cell.method == "belief"]
    largest = max(thetas, default=0.0)
    return [cell for cell in candidates if cell.method == "ce" or cell.labels["theta"] == largest]
