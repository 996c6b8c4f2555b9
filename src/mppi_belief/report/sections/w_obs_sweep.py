"""Fig. 2: the obstacle weight, for all four methods."""

from pathlib import Path

from .. import published
from ..cell_results import CellResults, by_method
from ..elements import cell_lines, write_page_table, write_picture
from ..figures.sweeps import figure_2
from ..page import Section


def w_obs_sweep_section(cells: list[CellResults], folder: Path) -> Section:
    """Builds the section: collisions of each method over all weights, the table, Fig. 2."""
    ranges = []
    for method_cells in by_method(cells).values():
        rates = [100 * float(cell.collided.mean()) for cell in method_cells if len(cell.good)]
        if rates:
            ranges.append(f"{method_cells[0].name} in {min(rates):.1f} to {max(rates):.1f} %")
    weights = sorted({cell.labels["w_obs"] for cell in cells if len(cell.good)})
    over = ", ".join(f"{weight:g}" for weight in weights)
    paper = []
    if any(cell.has_paper_settings(published.WEIGHT_KEY) for cell in cells):
        low, high = (100 * rate for rate in published.BASELINE_RANGE)
        paper = [
            "This sweep was held out of the calibration. In the paper the baselines stay within "
            f"{low:g} to {high:g} %."
        ]
    alt = (
        "Fig. 2: (a) collision rate and (b) base cost over the obstacle weight, with 95 % intervals"
    )
    return Section(
        "Fig. 2: the obstacle weight",
        [
            f"Trials that collide, lowest and highest rate over the weights {over}: "
            f"{', '.join(ranges)}.",
            *paper,
        ],
        [
            write_page_table(
                folder, "w_obs_sweep", "Every weight and method", cell_lines(cells), cells
            )
        ],
        write_picture(folder, "figure_2", lambda: figure_2(cells), alt),
    )
