"""Beyond the paper: a detour for information, planned with and without a covariance per path."""

from pathlib import Path

from ..cell_results import CellResults
from ..comparison import method_differences, multiplicity_text
from ..elements import (
    cell_lines,
    collision_text,
    cost_text,
    write_page_table,
    write_paths_of_methods,
)
from ..page import Section


def information_section(cells: list[CellResults], folder: Path) -> Section:
    """Builds the section: the table of all methods, paired differences, paths in the plane."""
    results = [
        f"{cell.name} costs {cost_text(cell)} and collides in {collision_text(cell)} of its trials."
        for cell in cells
        if len(cell.good)
    ]
    tables = [write_page_table(folder, "information", "Every method", cell_lines(cells), cells)]
    pairs = method_differences(cells, "belief_joint")
    if len(pairs):
        caption = f"A covariance per path against each method; {multiplicity_text(pairs)}"
        tables.append(write_page_table(folder, "information_differences", caption, pairs))
    return Section(
        "Beyond the paper: a detour for information",
        [
            "The vehicle does not know its position across the lanes, and being in the wrong lane "
            "is what costs. Its way leads through a gap in a wall in the dark; the light in which "
            "it could measure its position lies behind the start. A planner with one covariance "
            "for all sampled paths gains nothing from a detour to the light. A planner that "
            "propagates a covariance along every path (`controller=belief_joint`) does.",
            " ".join(results),
        ],
        tables,
        write_paths_of_methods(folder, "information", cells),
    )
