"""The planners of the study `margins`, and the cells in which one setting of a planner is swept.

Each planner keeps a distance from obstacles by one setting: theta, w_obs, or a number of standard
deviations, which is sqrt(c) of sigma points and k of a chance constraint.
"""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

from scipy.special import ndtri

from .cell_results import CellResults

SIGMA_POINTS = "sigma points"
EXACT_MOMENTS = "exact moments"
CHANCE = "chance constraint"
PLANNERS = (SIGMA_POINTS, EXACT_MOMENTS, CHANCE)
THETA = "theta"
WEIGHT = "w_obs"
DEVIATIONS = "deviations"
SETTINGS = (THETA, WEIGHT, DEVIATIONS)


def planner_of(cell: CellResults) -> str:
    """Returns which of `PLANNERS` a cell is of; "" for any other."""
    path_cost = _path_cost(cell)
    if "level" in path_cost:
        return CHANCE
    rules = {"sigma_points": SIGMA_POINTS, "exact": EXACT_MOMENTS}
    return rules.get(str(path_cost.get("variance")), "")


def setting_of(cell: CellResults, name: str) -> float:
    """Returns one of `SETTINGS` of a cell, NaN where its planner does not have it."""
    path_cost = _path_cost(cell)
    if name != DEVIATIONS:
        return float(cell.labels[name])
    if planner_of(cell) == CHANCE:
        return -float(ndtri(path_cost["level"] / path_cost["joint_steps"]))
    if planner_of(cell) == SIGMA_POINTS:
        return math.sqrt(path_cost["sigma_point_spread"])
    return math.nan


def cells_by_planner(cells: Sequence[CellResults]) -> dict[str, list[CellResults]]:
    """Groups the cells that have trials by planner, in the order of `PLANNERS`."""
    groups = {
        planner: [cell for cell in cells if len(cell.good) and planner_of(cell) == planner]
        for planner in PLANNERS
    }
    return {planner: group for planner, group in groups.items() if group}


def swept_cells(group: Sequence[CellResults], name: str) -> list[CellResults]:
    """Returns the cells of one planner in which one of `SETTINGS` is swept, sorted by it.

    The others have the value there that most cells of the planner have. Returns none where fewer
    than two values remain.
    """
    usual = {key: _most_common(group, key) for key in SETTINGS if key != name}
    swept = [
        cell
        for cell in group
        if math.isfinite(setting_of(cell, name))
        and all(_rounded(setting_of(cell, key)) == value for key, value in usual.items())
    ]
    values = {_rounded(setting_of(cell, name)) for cell in swept}
    return sorted(swept, key=lambda cell: setting_of(cell, name)) if len(values) > 1 else []


def setting_text(cell: CellResults) -> str:
    """Returns the settings of a cell's planner in words, "theta 1, w_obs 300, 2 sd"."""
    parts = [
        f"{name} {setting_of(cell, name):g}"
        for name in (THETA, WEIGHT)
        if math.isfinite(setting_of(cell, name))
    ]
    deviations = setting_of(cell, DEVIATIONS)
    if math.isfinite(deviations):
        parts.append(f"{deviations:.3g} sd")
    return ", ".join(parts)


def _most_common(group: Sequence[CellResults], name: str) -> float | None:
    values = Counter(_rounded(setting_of(cell, name)) for cell in group)
    return values.most_common(1)[0][0]


def _rounded(value: float) -> float | None:
    """Returns a number to nine digits, None for NaN, so that equal settings compare as equal."""
    return float(f"{value:.9g}") if math.isfinite(value) else None


def _path_cost(cell: CellResults) -> dict[str, Any]:
    path_cost = cell.config["controller"].get("path_cost")
    return path_cost if isinstance(path_cost, dict) else {}
