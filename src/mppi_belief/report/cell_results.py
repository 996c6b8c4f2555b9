"""What was found of a cell on disk, read once and handed to tables and figures."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..config.cell import Cell, labels
from ..results.columns import COLUMNS
from ..results.contents import CellContents, read_cell
from ..results.sources import sources_of
from .summary import label_text

METHOD_NAMES = {
    "belief": "MPPI-Belief",
    "belief_joint": "MPPI-Belief, a covariance a path",
    "ce": "CE-MPPI",
    "pipf": "PIPF",
    "ilqg": "EKF-iLQG",
    "algorithm_1": "Algorithm 1",
    "oracle": "Oracle",
    "lqg": "LQG",
}  # controllers by the names that the paper gives them


class CellResults(NamedTuple):
    """A cell and its results.

    rows        the first `wanted` trials that are done, one row each, failed ones too
    good        those of them that went well: what averages are taken of
    paths       a row per step of the kept trials among them: trial, step, state, mean, cov (flat), control
                with the position at the front of the state
    scene       dt, start, goal, obstacles, radius, noise; None where nothing was kept
    seconds     wall times of single control steps, empty where none were taken
    recording   one trial in detail (`mppi_belief.trial.recording`), or None
    sources     the provenance of every part file that holds one of the rows
    """

    cell: Cell
    wanted: int
    rows: pd.DataFrame
    paths: pd.DataFrame
    scene: dict[str, Any] | None
    seconds: list[float]
    recording: dict[str, Any] | None
    sources: list[dict[str, Any]]

    @property
    def good(self) -> pd.DataFrame:
        return self.rows[self.rows["status"] == "ok"]

    @property
    def missing(self) -> int:
        return self.wanted - len(self.rows)

    @property
    def labels(self) -> dict[str, Any]:
        return labels(self.cell.config)

    @property
    def method(self) -> str:
        """The controller's option, a key of `NAMES`."""
        return str(self.cell.config["names"]["controller"])

    @property
    def name(self) -> str:
        """The method as the paper calls it."""
        return METHOD_NAMES.get(self.method, self.method)

    @property
    def samples(self) -> int | None:
        """Paths sampled for one control step, from every particle where the method does that; None without any."""
        number = self.cell.config["controller"].get("n_samples")
        starts = self.cell.config["filter"].get("n_particles", 1) if self.method == "pipf" else 1
        return None if number is None else int(number * starts)

    @property
    def collided(self) -> np.ndarray:
        """Of the good trials, (n,) bool."""
        return self.good["collided"].to_numpy(dtype=bool)


def read_cell_results(
    cell: Cell, root: Path, wanted: int, warn: Callable[[str], object] = lambda line: None
) -> CellResults:
    """Read a cell's results; a file that cannot be read is named to `warn` and left out."""
    contents = read_cell(root / cell.id)
    for line in contents.problems:
        warn(line)
    rows = contents.rows[list(COLUMNS)]
    rows = rows[rows["trial"] < wanted].reset_index(drop=True)
    steps = contents.steps[contents.steps["trial"].isin(rows["trial"])]
    scene = _note(contents, "scene", {"dt", "start", "goal", "obstacles", "radius"})
    timing = _note(contents, "timing", {"seconds"})
    record = cell.config.get("record")
    return CellResults(
        cell,
        wanted,
        rows,
        _position_first(steps, scene),
        scene,
        timing["seconds"] if timing else [],
        _note(contents, f"recording-{record}", {"trial", "samples", "matching"}),
        sources_of(contents, rows["trial"]),
    )


def _position_first(steps: pd.DataFrame, scene: dict[str, Any] | None) -> pd.DataFrame:
    """Returns the steps with the position in front of the other components of state, mean and cov."""
    position = (scene or {}).get("position", [])
    if steps.empty or position == list(range(len(position))):
        return steps
    nx = len(steps["state"].iloc[0])
    order = [*position, *(i for i in range(nx) if i not in position)]
    block = np.ix_(order, order)
    states: Any = [np.asarray(state)[order] for state in steps["state"]]
    means: Any = [np.asarray(mean)[order] for mean in steps["mean"]]
    covs: Any = [np.reshape(cov, (nx, nx))[block].ravel() for cov in steps["cov"]]
    return steps.assign(state=states, mean=means, cov=covs)


def _note(contents: CellContents, name: str, keys: set[str]) -> dict[str, Any] | None:
    """Returns a JSON file beside the tables; None if it is missing or lacks one of the keys."""
    content = contents.notes.get(name)
    return content if content and keys <= content.keys() else None


def paired_rows(first: CellResults, second: CellResults) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The good rows of the trials that both have, in the same order: they met the same noise."""
    common = np.intersect1d(first.good["trial"], second.good["trial"])
    one, other = (found.good.set_index("trial").loc[common] for found in (first, second))
    return one, other


def by_method(founds: Sequence[CellResults]) -> dict[str, list[CellResults]]:
    """The cells of each method, in the order in which they are given."""
    methods: dict[str, list[CellResults]] = {}
    for found in founds:
        methods.setdefault(found.method, []).append(found)
    return methods


def differing_labels(founds: Sequence[CellResults]) -> list[dict[str, str]]:
    """The labels of each cell, as text, without those that are the same for all that have one."""
    labels = [{name: label_text(value) for name, value in found.labels.items()} for found in founds]
    names = dict.fromkeys(name for one in labels for name in one)
    told = [name for name in names if len({one.get(name, "-") for one in labels} - {"-"}) > 1]
    return [{name: one.get(name, "-") for name in told} for one in labels]


def cell_titles(founds: Sequence[CellResults]) -> list[str]:
    """A name for each cell: its method's, with the settings that differ where a method occurs more than once."""
    names = [found.name for found in founds]
    settings = [
        ", ".join(f"{name} {value}" for name, value in one.items() if name != "controller")
        for one in differing_labels(founds)
    ]
    pairs = zip(names, settings, strict=True)
    return [
        f"{name} ({setting})" if names.count(name) > 1 and setting else name
        for name, setting in pairs
    ]
