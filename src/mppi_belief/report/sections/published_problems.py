"""Beyond the paper: published problems whose robot sees its position best away from the goal."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ..cell_results import CellResults
from ..comparison import method_differences, multiplicity_text
from ..elements import cost_text, write_page_table, write_paths_of_methods
from ..page import Section
from ..statistics import mean_interval, proportion_interval
from ..summary import interval_text

LIGHT_REACH = 1.0  # m; a belief whose mean comes this near the light counts as in it; a choice


class KeptBeliefs(NamedTuple):
    """Holds what the n kept trials of a cell show of the belief."""

    furthest: np.ndarray  # (n,) largest first coordinate of the mean, m
    in_light: np.ndarray  # (n,) bool, whether the mean came within `LIGHT_REACH` of the light
    final_sd: np.ndarray  # (n,) standard deviation of a coordinate at the end, root mean square, m


def platt_2010_section(cells: list[CellResults], folder: Path) -> Section:
    """Builds the section of the light-dark domain of Platt et al. (RSS 2010)."""
    text = (
        "This is the light-dark domain of Platt et al. (RSS 2010), as far as its numbers could be "
        "read. A robot starts near (2, 2) without knowing its position well, goes to the origin, "
        "and is charged for its uncertainty at the end. It measures its position best at x = 5, "
        "away from the goal."
    )
    return _published_problem(cells, folder, "platt_2010", "Platt et al. 2010", text)


def van_den_berg_2012_section(cells: list[CellResults], folder: Path) -> Section:
    """Builds the section of the same domain with the cost of van den Berg et al. (IJRR 2012)."""
    text = (
        "This is the point robot in the same domain with the cost of van den Berg et al. (IJRR "
        "2012), which charges the final position and covariance much and the way there little. The "
        "start is known better."
    )
    return _published_problem(cells, folder, "van_den_berg_2012", "van den Berg et al. 2012", text)


def _published_problem(
    cells: list[CellResults], folder: Path, study: str, authors: str, text: str
) -> Section:
    """Builds a section: the table of all methods, paired differences, paths in the plane."""
    results = [
        f"{cell.name} costs {cost_text(cell)} and ends {_final_distance(cell)} m from the goal."
        for cell in cells
        if len(cell.good)
    ]
    tables = [write_page_table(folder, study, "Every method", problem_frame(cells), cells)]
    pairs = method_differences(cells, "belief_joint")
    if len(pairs):
        pairs = pairs[["Difference", "Pairs", "Cost [95 %]"]]
        caption = f"A covariance per path against each method; {multiplicity_text(pairs)}"
        tables.append(write_page_table(folder, f"{study}_differences", caption, pairs))
    return Section(
        f"Beyond the paper: the light-dark domain of {authors}",
        [
            text,
            " ".join(results),
            "A trial counts as in the light if the mean of the belief comes within "
            f"{LIGHT_REACH:g} m of it. This column, the furthest x and the belief's standard "
            "deviation are those of the kept trials.",
        ],
        tables,
        write_paths_of_methods(folder, study, cells),
    )


def problem_frame(cells: Sequence[CellResults]) -> pd.DataFrame:
    """Returns a line of text per cell."""
    return pd.DataFrame([_problem_line(cell) for cell in cells])


def _problem_line(cell: CellResults) -> dict[str, str]:
    """Returns the line of one cell."""
    beliefs = kept_beliefs(cell)
    in_light = proportion_interval(int(beliefs.in_light.sum()), len(beliefs.in_light))
    return {
        "method": cell.name,
        "trials": str(len(cell.good)),
        "cost [95 %]": cost_text(cell),
        "final distance m [95 %]": _final_distance(cell),
        "median distance m": f"{cell.good['final_distance'].median():.2f}",
        "furthest x m": _median(beliefs.furthest),
        "in the light % [95 %]": interval_text(in_light.times(100), 0),
        "belief sd at the end m": _median(beliefs.final_sd),
        "median NEES": f"{cell.good['nees'].median():.1f}",
    }


def kept_beliefs(cell: CellResults) -> KeptBeliefs:
    """Evaluates the beliefs of the kept trials that did not fail."""
    light = cell.config["system"]["light"]
    furthest = []
    in_light = []
    final_sd = []
    for _, steps in cell.good_paths.groupby("trial"):
        mean = np.stack(list(steps["mean"]))
        covariance = np.asarray(steps["cov"].iloc[-1]).reshape(mean.shape[1], -1)
        furthest.append(mean[:, 0].max())
        in_light.append(np.abs(mean[:, 0] - light).min() <= LIGHT_REACH)
        final_sd.append(np.sqrt(np.mean(covariance.diagonal())))
    return KeptBeliefs(np.array(furthest), np.array(in_light, dtype=bool), np.array(final_sd))


def _final_distance(cell: CellResults) -> str:
    """Returns the mean distance to the goal at the end, with its interval."""
    return interval_text(mean_interval(cell.good["final_distance"].to_numpy()), 2)


def _median(values: np.ndarray) -> str:
    return f"{np.median(values):.2f}" if len(values) else "-"
