"""The matching residual of (15) along the recorded trial of MPPI-Belief (Proposition 3)."""

import math
from collections.abc import Sequence
from pathlib import Path

from .. import published
from ..cell_results import CellResults, by_method
from ..elements import write_picture
from ..figures.diagnostics import residual_figure
from ..page import Section


def residual_sections(cells: Sequence[CellResults], folder: Path) -> list[Section]:
    """Builds the section from the cells of Table I; returns none without a recorded trial."""
    belief = by_method(cells).get("belief", [])
    recorded = [cell for cell in belief if cell.recording and cell.scene]
    if not recorded or recorded[0].recording is None:
        return []
    lowest = []
    for reading, curves in recorded[0].recording["matching"].items():
        residuals = [value for value in curves["optimum"] if value is not None]
        lowest.append(f"{min(residuals, default=math.nan):.2f} (sigma_o as {reading})")
    alt = (
        "Matching residual over time along one trial of MPPI-Belief: with the best weight, and "
        "with the weight that the planner imposes"
    )
    text = (
        "The control acts on the velocity only, so only the velocity block of the diffusion can be "
        "matched (Proposition 3). Whatever the weight, the residual of (15) along a trial of "
        f"MPPI-Belief is never below {' and '.join(lowest)}."
    )
    if recorded[0].has_paper_settings():
        text += (
            f" The paper prints {published.RESIDUAL}; the steady state in the light, with sigma_o "
            "as an intensity, is 0.80."
        )
    pictures = write_picture(folder, "matching", lambda: residual_figure(recorded[0]), alt)
    return [Section("The matching residual", [text], [], pictures)]
