"""Matching by choosing what is sensed: what it does to Algorithm 1 as printed."""

import math
from pathlib import Path

from .. import figures
from ..cell_results import CellResults, paired_rows
from ..elements import cell_lines, cost_text, write_picture, write_table
from ..figures.sensing import SENSORS
from ..page import Section
from ..statistics import paired_mean_difference
from ..summary import interval_text


def sensing(founds: list[CellResults], folder: Path) -> Section:
    """The section of the study `controlled_sensing`."""
    limited = [one for one in founds if one.method == "algorithm_1" and selector(one) == "matched"]
    limited = sorted(
        limited, key=lambda one: math.inf if limit(one) is None else float(limit(one) or 0)
    )
    chosen = [one for one in founds if limit(one) is None]
    tables = [
        write_table(
            folder,
            "controlled_sensing",
            "By method, sensor and its limit",
            cell_lines(founds),
            founds,
        )
    ]
    alt = "Mean position over time by method and sensor; cost of Algorithm 1 over the limit of the sensor"
    return Section(
        "Matching by choosing what is sensed",
        [
            "Das and Tanaka's sequel (arXiv 2604.18941) makes the observation matrix a control. Here it is chosen from "
            "the covariance so that matching (15) holds exactly at every step, on a moored platform in the plane that "
            "is to be held away from where it rests; the fixed sensor measures its position with the same noise.",
            *(text for name in SENSORS if (text := _against(chosen, name))),
            "What the sensor is chosen for is matching, not knowledge: it moves the estimate of the velocity only. A "
            "limit on its signal-to-noise ratio leaves a residual of (15), and what Algorithm 1 loses by it.",
        ],
        tables,
        write_picture(folder, "controlled_sensing", figures.sensing_figure(chosen, limited), alt),
    )


def selector(found: CellResults) -> str:
    """ "matched" or "fixed"."""
    return str(found.cell.config["system"].get("selector", "fixed"))


def limit(found: CellResults) -> float | None:
    """The largest signal-to-noise ratio of the sensor, None for any."""
    return found.cell.config["system"].get("limit")


def _against(chosen: list[CellResults], name: str) -> str:
    """Algorithm 1 with one sensor against the matched proposal and LQG with the same, trial by trial."""
    there = {one.method: one for one in chosen if selector(one) == name and len(one.good)}
    if "algorithm_1" not in there:
        return ""
    first, said = there["algorithm_1"], []
    for other in ("belief", "lqg"):
        if other in there:
            one, two = paired_rows(first, there[other])
            more = paired_mean_difference(one["cost"].to_numpy(), two["cost"].to_numpy())
            said.append(f"{interval_text(more, 2)} more than {there[other].name}")
    told = f", {' and '.join(said)}" if said else ""
    return f"{SENSORS[name].capitalize()}: Algorithm 1 as printed costs {cost_text(first)}{told}."
