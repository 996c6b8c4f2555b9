"""Beyond the paper: a start in one of two lanes, believed as a mixture or as one Gaussian."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .. import figures
from ..cell_results import CellResults, cell_titles
from ..elements import cell_lines, collision_text, write_picture, write_table
from ..page import Section
from ..statistics import Estimate, proportion_interval
from ..summary import interval_text

NEAR = 1.0  # m of the goal at the end of a trial; a choice


def two_lanes(founds: list[CellResults], folder: Path) -> Section:
    """The table of all cells with how many trials arrived, and the paths of both filters side by side."""
    frame = cell_lines(founds)
    frame.insert(
        list(frame.columns).index("trials"), "planned from", [_seen(one) for one in founds]
    )
    told = [interval_text(arrivals(one).times(100), 1) for one in founds]
    frame.insert(list(frame.columns).index("collided % [95 %]") + 1, "arrived % [95 %]", told)
    said = [
        f"{title} collides in {collision_text(one)} of the trials and arrives in {arrived} %."
        for title, one, arrived in zip(_titles(founds), founds, told, strict=True)
        if len(one.good)
    ]
    alt = "Paths in the plane: MPPI-Belief and CE-MPPI, each on a mixture and on one Gaussian"
    return Section(
        "Beyond the paper: a belief with two modes",
        [
            "The vehicle starts in one of two lanes, is not told which, and can hardly see it from there; an obstacle "
            "stands between the lanes and one beside each. Both lanes are free. One Gaussian with the mean and "
            "covariance of the two has its mean before the obstacle between them. With filter=mixture each lane is a "
            f"Gaussian by itself, and so it is planned from. Arrived: within {NEAR:g} m of the goal at the end.",
            " ".join(said),
        ],
        [write_table(folder, "two_lanes", "Every filter and planner", frame, founds)],
        write_picture(
            folder,
            "two_lanes",
            figures.compare_paths(shown) if (shown := panels(founds)) else None,
            alt,
        ),
    )


def _titles(founds: Sequence[CellResults]) -> list[str]:
    """Names of cells, those whose planner is shown the moments alone told from the others."""
    named = zip(cell_titles(founds), founds, strict=True)
    return [f"{title}, from moments," if _seen(one) == "moments" else title for title, one in named]


def _seen(found: CellResults) -> str:
    """What MPPI-Belief was shown of a mixture, where the study sets it."""
    return str(found.labels.get("controller.plan_from", "-"))


def arrivals(found: CellResults) -> Estimate:
    """The part of the good trials that end near the goal."""
    there = np.asarray(found.good["final_distance"] < NEAR)
    return proportion_interval(int(there.sum()), len(there))


def panels(founds: Sequence[CellResults]) -> list[figures.PathPanel]:
    """MPPI-Belief, as averse to risk as the study has it, then CE-MPPI, each with both filters."""
    plain = [one for one in founds if "filter" in one.labels and _seen(one) == "-"]
    most = max((one.labels["theta"] for one in plain if one.method == "belief"), default=0.0)
    chosen = [one for one in plain if one.method == "ce" or one.labels["theta"] == most]
    return [
        figures.PathPanel(
            paths,
            scene,
            set(one.good["trial"][one.collided]),
            f"{one.name}, filter={one.labels['filter']}",
        )
        for one in chosen
        if (kept := figures.kept_in_plane(one))
        for scene, paths in [kept]
    ]
