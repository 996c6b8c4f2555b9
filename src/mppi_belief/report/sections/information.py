"""Beyond the paper: a way not to be gone before one has looked, with and without a covariance for every path."""

from collections.abc import Sequence
from pathlib import Path

from .. import figures
from ..cell_results import Found
from ..comparison import differences
from ..elements import cost, lines, picture, rate, table
from ..page import Section

SHOWN = ("belief_joint", "belief", "ce", "ilqg")


def information(founds: list[Found], folder: Path) -> Section:
    """The table of all methods, differences trial by trial, paths in the plane."""
    said = [
        f"{one.name} costs {cost(one)} and collides in {rate(one)} of its trials."
        for one in founds
        if len(one.good)
    ]
    tables = [table(folder, "information", "Every method", lines(founds), founds)]
    if len(pairs := differences(founds, "belief_joint")):
        title = "A covariance for every path against each method, trial by trial"
        tables.append(table(folder, "information_differences", title, pairs))
    alt = (
        "Paths in the plane: who goes to the light first, who goes through the gap blind, who waits"
    )
    return Section(
        "Beyond the paper: look before you go",
        [
            "Across the lanes the vehicle's place is not known; the wrong one is what costs, and the way leads "
            "through a gap in a wall that stands in the dark. The light that would tell is behind the start. With one "
            "covariance for all paths no plan can gain by going there; with one for every path "
            "(controller=belief_joint) it can.",
            " ".join(said),
        ],
        tables,
        picture(
            folder,
            "information",
            figures.compare(shown) if (shown := panels(founds)) else None,
            alt,
        ),
    )


def panels(founds: Sequence[Found]) -> list[figures.Run]:
    """What a picture shows: the planners that look, wait, and do not care."""
    return [
        figures.Run(paths, scene, set(one.good["trial"][one.collided]), one.name)
        for method in SHOWN
        for one in founds
        if one.method == method and (kept := figures.kept_in_plane(one))
        for scene, paths in [kept]
    ]
