"""Beyond the paper: a way not to be gone before one has looked, with and without a covariance for every path."""

from collections.abc import Sequence
from pathlib import Path

from .. import figures
from ..cell_results import CellResults
from ..comparison import method_differences
from ..elements import cell_lines, collision_text, cost_text, write_picture, write_table
from ..page import Section

SHOWN = ("belief_joint", "belief", "ce", "ilqg")


def information(founds: list[CellResults], folder: Path) -> Section:
    """The table of all methods, differences trial by trial, paths in the plane."""
    said = [
        f"{one.name} costs {cost_text(one)} and collides in {collision_text(one)} of its trials."
        for one in founds
        if len(one.good)
    ]
    tables = [write_table(folder, "information", "Every method", cell_lines(founds), founds)]
    if len(pairs := method_differences(founds, "belief_joint")):
        title = "A covariance for every path against each method, trial by trial"
        tables.append(write_table(folder, "information_differences", title, pairs))
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
        write_picture(
            folder,
            "information",
            figures.compare_paths(shown) if (shown := panels(founds)) else None,
            alt,
        ),
    )


def panels(founds: Sequence[CellResults]) -> list[figures.PathPanel]:
    """What a picture shows: the planners that look, wait, and do not care."""
    return [
        figures.PathPanel(paths, scene, set(one.good["trial"][one.collided]), one.name)
        for method in SHOWN
        for one in founds
        if one.method == method and (kept := figures.kept_in_plane(one))
        for scene, paths in [kept]
    ]
