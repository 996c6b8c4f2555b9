"""Reads the results of a cell once, for all tables and figures; pairs, groups and names cells."""

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..config.cell import Cell, labels
from ..results.columns import COLUMNS
from ..results.contents import CellContents, read_cell
from ..results.sources import sources_of
from ..results.timing_load import measured_busy
from .positions import position_first
from .summary import label_text

METHOD_NAMES = {
    "belief": "MPPI-Belief",
    "belief_joint": "MPPI-Belief with a covariance per path",
    "ce": "CE-MPPI",
    "chance": "Chance-constrained MPPI",
    "pipf": "PIPF",
    "ilqg": "EKF-iLQG",
    "algorithm_1": "Algorithm 1",
    "oracle": "Oracle",
    "lqg": "LQG",
}  # options of `controller`, and the names of the methods in the paper


class CellResults(NamedTuple):
    """Holds a cell and the results that a results folder has of it."""

    cell: Cell
    wanted: int  # number of trials that the report asks for
    rows: pd.DataFrame  # one row per finished trial below `wanted`, failed trials too
    # One row per step of a kept trial: trial, step, state, mean, cov (flat), control. The position
    # comes first in state, mean and cov.
    paths: pd.DataFrame
    scene: dict[str, Any] | None  # dt, start, goal, obstacles, ...; None without kept trials
    seconds: list[float]  # wall times of single control steps, s; empty where none were measured
    recording: dict[str, Any] | None  # one trial in detail, see `mppi_belief.trial.recording`
    sources: list[dict[str, Any]]  # provenance of every file that holds one of the rows
    busy: bool = False  # whether the times were measured while other work kept the machine busy
    # Keys in which the settings depart from those of Table I for this method, such as `cost.w_obs`;
    # None where they were not compared with Table I's, or where it has no such method.
    departures: tuple[str, ...] | None = None

    @property
    def config(self) -> dict[str, Any]:
        """Returns the configuration of the cell."""
        return self.cell.config

    @property
    def id(self) -> str:
        """Returns the identity of the cell, which names its folder."""
        return self.cell.id

    def has_paper_settings(self, *varied: str) -> bool:
        """Returns whether the settings are those of the paper's study, but for the keys `varied`.

        Only the results of such cells may stand beside numbers of the paper.
        """
        return self.departures is not None and set(self.departures) <= set(varied)

    @property
    def good(self) -> pd.DataFrame:
        """Returns the rows of the trials that did not fail; averages are taken over these."""
        return self.rows[self.rows["status"] == "ok"]

    @property
    def good_paths(self) -> pd.DataFrame:
        """Returns the steps of the kept trials that did not fail."""
        return self.paths[self.paths["trial"].isin(self.good["trial"])]

    @property
    def collided(self) -> np.ndarray:
        """Returns whether each good trial collided, (n,) bool."""
        return self.good["collided"].to_numpy(dtype=bool)

    @property
    def collided_trials(self) -> set[int]:
        """Returns the numbers of the good trials that collided."""
        return set(self.good["trial"][self.collided])

    @property
    def missing(self) -> int:
        """Returns the number of trials that are still to be run."""
        return self.wanted - len(self.rows)

    @property
    def labels(self) -> dict[str, Any]:
        """Returns the settings that tell this cell from the others of a study."""
        return labels(self.cell.config)

    @property
    def system(self) -> str:
        """Returns the option of `system`."""
        return str(self.config["names"]["system"])

    @property
    def method(self) -> str:
        """Returns the option of `controller`, a key of `METHOD_NAMES`."""
        return str(self.config["names"]["controller"])

    @property
    def name(self) -> str:
        """Returns the name of the method in the paper."""
        return METHOD_NAMES.get(self.method, self.method)

    @property
    def samples(self) -> int | None:
        """Returns the number of paths sampled per control step; None for a method without samples.

        PIPF samples its paths from every particle.
        """
        number = self.config["controller"].get("n_samples")
        starts = self.config["filter"].get("n_particles", 1) if self.method == "pipf" else 1
        return None if number is None else int(number * starts)


Studies = dict[str, list[CellResults]]  # the cells of each study by its name in conf/experiment/


def read_cell_results(
    cell: Cell, root: Path, wanted: int, warn: Callable[[str], object] = lambda line: None
) -> CellResults:
    """Reads the results of the first `wanted` trials of a cell from the results folder `root`.

    A file that cannot be read is named to `warn` and left out.
    """
    contents = read_cell(root / cell.id)
    for problem in contents.problems:
        warn(problem)

    # The tables: rows of trials, and steps of the kept trials among them.
    rows = contents.rows[list(COLUMNS)]
    rows = rows[rows["trial"] < wanted].reset_index(drop=True)
    steps = contents.steps[contents.steps["trial"].isin(rows["trial"])]

    # The files beside the tables.
    scene = _read_notes(contents, "scene", {"dt", "start", "goal", "obstacles", "radius"})
    steps, scene = position_first(steps, scene)
    timing = _read_notes(contents, "timing", {"seconds"})
    recording_name = f"recording-{cell.config.get('record')}"
    recording_keys = {"trial", "collided_at", "samples", "matching"}
    recording = _read_notes(contents, recording_name, recording_keys)

    return CellResults(
        cell=cell,
        wanted=wanted,
        rows=rows,
        paths=steps,
        scene=scene,
        seconds=timing["seconds"] if timing else [],
        recording=recording,
        sources=sources_of(contents, rows["trial"]),
        busy=timing is not None and measured_busy(timing),
    )


def _read_notes(contents: CellContents, name: str, keys: set[str]) -> dict[str, Any] | None:
    """Returns a JSON file beside the tables; None if it is absent or lacks one of the keys."""
    content = contents.notes.get(name)
    return content if content and keys <= content.keys() else None


def paired_rows(first: CellResults, second: CellResults) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Returns the good rows of the trials that both cells have, in the same order.

    Trials of one number meet the same noise in all cells, so their difference has less spread.
    """
    common = np.intersect1d(first.good["trial"], second.good["trial"])
    first_rows = first.good.set_index("trial").loc[common]
    second_rows = second.good.set_index("trial").loc[common]
    return first_rows, second_rows


def by_method(cells: Sequence[CellResults]) -> dict[str, list[CellResults]]:
    """Groups the cells by method; keeps the order in which they are given."""
    methods: dict[str, list[CellResults]] = {}
    for cell in cells:
        methods.setdefault(cell.method, []).append(cell)
    return methods


def differing_labels(cells: Sequence[CellResults]) -> list[dict[str, str]]:
    """Returns the labels of each cell as text, without those that have one value in all cells."""
    labels = [{name: label_text(value) for name, value in cell.labels.items()} for cell in cells]
    names = dict.fromkeys(itertools.chain.from_iterable(labels))
    differing = []
    for name in names:
        values = {cell_labels.get(name, "-") for cell_labels in labels} - {"-"}
        if len(values) > 1:
            differing.append(name)
    return [{name: cell_labels.get(name, "-") for name in differing} for cell_labels in labels]


def cell_titles(cells: Sequence[CellResults]) -> list[str]:
    """Names each cell by its method and, if that is ambiguous, by the settings that differ."""
    names = [cell.name for cell in cells]
    titles = []
    for name, differing in zip(names, differing_labels(cells), strict=True):
        settings = [f"{key} {value}" for key, value in differing.items() if key != "controller"]
        is_ambiguous = names.count(name) > 1 and settings
        titles.append(f"{name} ({', '.join(settings)})" if is_ambiguous else name)
    return titles


class FailureKind(NamedTuple):
    """Holds an example of the trials of a cell that failed in one way."""

    status: str  # error, crashed, timeout or diverged
    trial: int  # the first that failed so
    line: str  # the cell, how many there are, and what befell this trial


def failure_kinds(cell: CellResults) -> list[FailureKind]:
    """Returns an example of each kind of failure among the trials of a cell."""
    kinds = []
    for status, rows in cell.rows[cell.rows["status"] != "ok"].groupby("status"):
        first = rows.iloc[0]
        example = f"trial {first['trial']}: {first['error']}"
        line = f"{cell.id}: {len(rows)} {status}, e.g. {example}"
        kinds.append(FailureKind(str(status), int(first["trial"]), line))
    return kinds
