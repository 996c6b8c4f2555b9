"""Beyond the paper: problems that others published, who goes to the light and what that is worth."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from .. import figures
from ..cell_results import CellResults
from ..comparison import method_differences
from ..elements import cost_text, write_picture, write_table
from ..page import Section
from ..statistics import Estimate, mean_interval, proportion_interval
from ..summary import interval_text
from .information import panels

NEAR = 1.0  # m of the light that count as in it; a choice
SOURCES = {
    "platt_2010": (
        "Platt et al. 2010",
        "The light-dark domain of Platt et al. (RSS 2010), as far as its numbers could be read: a robot that starts "
        "near (2, 2), it does not know well where, goes to the origin and is charged for what it then does not know. "
        "It sees its place best at x = 5, away from the goal.",
    ),
    "van_den_berg_2012": (
        "van den Berg et al. 2012",
        "The point robot in the same domain with the cost of van den Berg et al. (IJRR 2012), who charge the final "
        "place and covariance much and the way there little; the start is known better.",
    ),
}


class Seen(NamedTuple):
    """What the kept trials of a cell show of the belief: how far right its mean went (m), whether it came near the
    light, its standard deviation at the end (m), of one coordinate."""

    furthest: np.ndarray
    lit: np.ndarray
    spread: np.ndarray


def published_problem(name: str, founds: list[CellResults], folder: Path) -> Section:
    """The table of all methods, differences trial by trial, paths in the plane."""
    source, text = SOURCES[name]
    said = [
        f"{one.name} costs {cost_text(one)} and ends {_away(one)} m off."
        for one in founds
        if len(one.good)
    ]
    tables = [write_table(folder, name, "Every method", lines(founds), founds)]
    if len(pairs := method_differences(founds, "belief_joint")):
        pairs = pairs[["Difference", "Pairs", "Cost [95 %]"]]
        title = "A covariance for every path against each method, trial by trial"
        tables.append(write_table(folder, f"{name}_differences", title, pairs))
    alt = "Paths in the plane: who goes to the light before the goal, and who does not"
    return Section(
        f"Beyond the paper: the light-dark domain of {source}",
        [
            text,
            " ".join(said),
            f"In the light: the mean of the belief comes within {NEAR:g} m of it; kept trials.",
        ],
        tables,
        write_picture(
            folder, name, figures.compare_paths(shown) if (shown := panels(founds)) else None, alt
        ),
    )


BUILDERS: dict[str, Callable[[list[CellResults], Path], Section]] = {
    name: partial(published_problem, name) for name in SOURCES
}


def lines(founds: Sequence[CellResults]) -> pd.DataFrame:
    """A line of text a cell."""
    return pd.DataFrame([_line(one) for one in founds])


def _line(found: CellResults) -> dict[str, str]:
    good, beliefs = found.good, seen(found)
    lit = proportion_interval(int(beliefs.lit.sum()), len(beliefs.lit))
    return {
        "method": found.name,
        "trials": str(len(good)),
        "cost [95 %]": cost_text(found),
        "final distance m [95 %]": _away(found),
        "its median": f"{good['final_distance'].median():.2f}",
        "furthest x m": _median(beliefs.furthest),
        "in the light % [95 %]": interval_text(lit.times(100), 0),
        "belief sd at the end m": _median(beliefs.spread),
        "median NEES": f"{good['nees'].median():.1f}",
    }


def seen(found: CellResults) -> Seen:
    """Of the kept trials that went well."""
    light, made = found.cell.config["system"]["light"], []
    paths = found.paths[found.paths["trial"].isin(found.good["trial"])]
    for _, steps in paths.groupby("trial"):
        mean, last = np.stack(list(steps["mean"])), np.asarray(steps["cov"].iloc[-1])
        variances = last.reshape(mean.shape[1], -1).diagonal()
        made.append(
            (
                mean[:, 0].max(),
                np.abs(mean[:, 0] - light).min() <= NEAR,
                np.sqrt(np.mean(variances)),
            )
        )
    furthest, lit, spread = zip(*made, strict=True) if made else ((), (), ())
    return Seen(np.array(furthest), np.array(lit, dtype=bool), np.array(spread))


def _away(found: CellResults) -> str:
    """Mean distance to the goal at the end and its interval."""
    away: Estimate = mean_interval(found.good["final_distance"].to_numpy())
    return interval_text(away, 2)


def _median(values: np.ndarray) -> str:
    return f"{np.median(values):.2f}" if len(values) else "-"
