"""Algorithm 1 as printed against the matched diffusion and LQG, on two systems."""

from pathlib import Path

from ..cell_results import CellResults
from ..comparison import method_differences
from ..elements import cell_lines, write_page_table
from ..page import Section


def diffusion_section(cells: list[CellResults], folder: Path) -> Section:
    """Builds the section: the table of all cells, and per system the differences to LQG."""
    caption = "Two systems, three controllers, theta = 0"
    tables = [write_page_table(folder, "diffusion", caption, cell_lines(cells), cells)]
    for system in dict.fromkeys(cell.system for cell in cells):
        pairs = method_differences([cell for cell in cells if cell.system == system], "lqg")
        if len(pairs):
            caption = f"LQG against each controller, trial by trial: {system}"
            tables.append(write_page_table(folder, f"diffusion_{system}", caption, pairs))
    return Section(
        "Matched diffusion or Algorithm 1 as printed",
        [
            "On the scalar system matching holds exactly, and LQG is the optimum. Algorithm 1 as "
            "printed and the planner with a warm-started nominal cost more because they sample and "
            "because their horizon is shorter. On the light-dark system the innovation hardly "
            "moves the velocity in the dark, so Algorithm 1 as printed hardly steers there. LQG "
            "ignores the obstacles."
        ],
        tables,
    )
