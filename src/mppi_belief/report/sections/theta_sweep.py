"""The theta sweep of Sec. VII: what the variance of the obstacle penalty (Remark 4) does."""

from pathlib import Path

from .. import published
from ..cell_results import CellResults
from ..elements import cell_lines, collision_text, write_page_table, write_picture
from ..figures.sweeps import theta_figure
from ..page import Section


def theta_sweep_section(cells: list[CellResults], folder: Path) -> Section:
    """Builds the section: collisions by theta, the table, the figure with the paper's values."""
    rates = [
        f"{collision_text(cell)} at theta = {cell.labels['theta']:g}"
        for cell in cells
        if len(cell.good)
    ]
    is_papers = any(cell.has_paper_settings(published.THETA_KEY) for cell in cells)
    caption = "MPPI-Belief by risk aversion"
    alt = "Collision rate, clearance and cost over theta, with 95 % intervals"
    if is_papers:
        alt += " and the paper's values"
    return Section(
        "The theta sweep",
        [
            f"Trials that collide, by risk aversion: {', '.join(rates)}.",
            *(["This sweep was held out of the calibration."] if is_papers else []),
        ],
        [write_page_table(folder, "theta_sweep", caption, cell_lines(cells), cells)],
        write_picture(folder, "theta_sweep", lambda: theta_figure(cells), alt),
    )
