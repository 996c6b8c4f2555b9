"""Algorithm 1 as printed against the matched diffusion and LQG, per system."""

from pathlib import Path

from ..cell_results import CellResults
from ..comparison import method_differences, multiplicity_text
from ..elements import cell_lines, collision_text, cost_text, write_page_table
from ..page import Section


def diffusion_section(cells: list[CellResults], folder: Path) -> Section:
    """Builds the section: the table of all cells, and per system the differences to LQG."""
    caption = "Every system and controller"
    tables = [write_page_table(folder, "diffusion", caption, cell_lines(cells), cells)]
    sentences = []
    for system in dict.fromkeys(cell.system for cell in cells):
        of_system = [cell for cell in cells if cell.system == system]
        pairs = method_differences(of_system, "lqg")
        if len(pairs):
            caption = f"LQG against each controller on {system}; {multiplicity_text(pairs)}"
            tables.append(write_page_table(folder, f"diffusion_{system}", caption, pairs))
        sentences += [
            f"On {system} {cell.name} costs {cost_text(cell)} and collides in "
            f"{collision_text(cell)} of its trials."
            for cell in of_system
            if len(cell.good)
        ]
    return Section(
        "Matched diffusion or Algorithm 1 as printed",
        [
            "On `scalar_linear` matching holds exactly, and LQG is the optimum. The planners "
            "sample, and look ahead over a shorter horizon. On `light_dark` the innovation is what "
            "Algorithm 1 as printed steers with, and LQG ignores the obstacles.",
            " ".join(sentences),
        ],
        tables,
    )
