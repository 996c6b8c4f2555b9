"""Matching (15) by choosing the sensor: what it does to Algorithm 1 as printed."""

import math
from collections.abc import Sequence
from pathlib import Path

from ..cell_results import CellResults
from ..comparison import cost_difference
from ..elements import cell_lines, cost_text, write_page_table, write_picture
from ..figures.sensing import SENSORS, sensing_figure
from ..page import Section
from ..summary import interval_text


def controlled_sensing_section(cells: list[CellResults], folder: Path) -> Section:
    """Builds the section: the table, each sensor's cost, mean positions and cost over the limit."""
    limited = [
        cell for cell in cells if cell.method == "algorithm_1" and selector(cell) == "matched"
    ]
    limited.sort(key=_limit_or_infinity)
    unlimited = [cell for cell in cells if sensor_limit(cell) is None]
    sensor_texts = [_algorithm_1_costs(unlimited, name) for name in SENSORS]
    stem = "controlled_sensing"
    caption = "By method, sensor and the limit of the sensor"
    alt = (
        "Mean position over time by method and sensor; cost of Algorithm 1 over the limit of the "
        "sensor"
    )
    return Section(
        "Matching by choosing the sensor",
        [
            "Das and Tanaka's sequel (arXiv 2604.18941) makes the observation matrix a control. "
            "Here it is chosen from the covariance so that matching (15) holds exactly at every "
            "step. The system is a moored platform in the plane, which is to be held away from its "
            "rest position. The fixed sensor measures the position with the same noise.",
            *filter(None, sensor_texts),
            "The sensor is chosen for matching and not for information: it corrects the estimate "
            "of the velocity only. With a limit on its signal-to-noise ratio a residual of (15) "
            "remains.",
        ],
        [write_page_table(folder, stem, caption, cell_lines(cells), cells)],
        write_picture(folder, stem, lambda: sensing_figure(unlimited, limited), alt),
    )


def selector(cell: CellResults) -> str:
    """Returns how the sensor is chosen: "matched" or "fixed"."""
    return str(cell.config["system"].get("selector", "fixed"))


def sensor_limit(cell: CellResults) -> float | None:
    """Returns the largest signal-to-noise ratio of the sensor, None where it has no limit."""
    limit = cell.config["system"].get("limit")
    return None if limit is None else float(limit)


def _limit_or_infinity(cell: CellResults) -> float:
    limit = sensor_limit(cell)
    return math.inf if limit is None else limit


def _algorithm_1_costs(cells: Sequence[CellResults], sensor: str) -> str:
    """Compares Algorithm 1 with the matched diffusion and LQG, all with the same sensor."""
    methods = {cell.method: cell for cell in cells if selector(cell) == sensor and len(cell.good)}
    if "algorithm_1" not in methods:
        return ""
    algorithm_1 = methods["algorithm_1"]
    differences = [
        f"{interval_text(cost_difference(algorithm_1, methods[method]), 2)} more than "
        f"{methods[method].name}"
        for method in ("belief", "lqg")
        if method in methods
    ]
    comparison = f", {' and '.join(differences)}" if differences else ""
    costs = f"costs {cost_text(algorithm_1)}{comparison}"
    return f"With the {SENSORS[sensor]}, Algorithm 1 as printed {costs}."
