"""What the files of one cell say: rows, and for each the run it comes from.

A cell is read file by file, so that a row can be traced to its file and its source: the run it comes from, with that
run's configuration, command, commit and versions. Nothing in these files is run, imported or unpickled.
"""

import json
from bisect import bisect_right
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import pyarrow.compute as pc

from ..config.cell import ALGORITHM_VERSION, IDENTITY, Cell, labels
from .files import read_json
from .table import Stored, each_once, ranges, read_parts, read_steps


class Contents(NamedTuple):
    """What could be read of a cell, and a line for every file that could not.

    paths       its files of trajectories; they are read first: a run writes a trial's row after its path
    parts       its part files
    notes       its JSON files by name, without the ending
    problems    what is wrong, a line each
    """

    folder: Path
    paths: list[Stored]
    parts: list[Stored]
    notes: dict[str, dict[str, Any]]
    problems: list[str]

    @property
    def sources(self) -> list[dict[str, Any]]:
        """Where the rows come from, in the order of the part files."""
        return [source for part in self.parts for source in part.about["sources"]]

    @property
    def config(self) -> dict[str, Any] | None:
        """The configuration, as the first source that has one says."""
        found = (source.get("config") for source in self.sources)
        return next((config for config in found if isinstance(config, dict) and config), None)

    @property
    def rows(self) -> pd.DataFrame:
        """Each trial once, as `mppi_belief.results.table.read_rows` has it, and `_file`, the name of its file."""
        frames = [part.table.to_pandas().assign(_file=part.path.name) for part in self.parts]
        return (
            each_once(pd.concat(frames, ignore_index=True))
            if frames
            else pd.DataFrame(columns=["trial", "status"])
        )

    @property
    def formats(self) -> set[int]:
        """The formats of all tables."""
        return {int(one.about["format"]) for one in (*self.parts, *self.paths)}


def read_cell(folder: Path) -> Contents:
    """Read every file of a cell; what cannot be read is a problem and left out."""
    problems: list[str] = []
    paths, parts = read_steps(folder, problems.append), read_parts(folder, problems.append)
    notes = {}
    for path in sorted(folder.glob("[!.]*.json")):
        content = read_json(folder, path.stem)
        if content is None:
            problems.append(f"{path}: not a file of ours, torn, or changed since it was written")
        else:
            notes[path.stem] = content
    return Contents(folder, paths, parts, notes, problems)


def origin(contents: Contents) -> Callable[[int, str], dict[str, Any]]:
    """A function that says which source the row of a trial in a part file comes from; {} where none says so."""
    nothing: dict[str, Any] = {}
    spans: dict[str, list[tuple[int, int, dict[str, Any]]]] = {}
    for part in contents.parts:
        pairs = (
            (first, last, source)
            for source in part.about["sources"]
            for first, last in source["trials"]
        )
        spans[part.path.name] = sorted(pairs, key=lambda span: span[:2])

    def find(trial: int, file: str) -> dict[str, Any]:
        within = spans[file]
        at = bisect_right(within, trial, key=lambda span: span[0]) - 1
        return within[at][2] if at >= 0 and trial <= within[at][1] else nothing

    return find


def runs(contents: Contents, rows: pd.DataFrame) -> list[dict[str, Any]]:
    """One source for each run, with just the trials of these rows that it made (`_file` as `Contents.rows` has it) and
    the longest time since its start. Runs are the same where all but that is."""
    find, known = (
        origin(contents),
        dict[int, str](),
    )  # by identity: rows of one source share the very same dict
    found: dict[str, tuple[dict[str, Any], list[int], list[float]]] = {}
    for trial, file in zip(rows["trial"], rows.get("_file", ()), strict=True):
        source = find(trial, file)
        if id(source) not in known:
            same = {
                name: value for name, value in source.items() if name not in ("trials", "elapsed")
            }
            known[id(source)] = json.dumps(same, sort_keys=True)
            times = found.setdefault(known[id(source)], (same, [], []))[2]
            times += [source["elapsed"]] if "elapsed" in source else []
        found[known[id(source)]][1].append(trial)
    return [
        {"trials": ranges(trials), **same} | ({"elapsed": max(times)} if times else {})
        for same, trials, times in found.values()
    ]


def row_of(contents: Contents, trial: int) -> tuple[dict[str, Any], dict[str, Any]] | None:
    """The row of a trial as it was written and the source it comes from; None where there is none."""
    rows = contents.rows
    for at in rows.index[rows["trial"] == trial]:
        file, status = str(rows.at[at, "_file"]), rows.at[at, "status"]
        (part,) = (part for part in contents.parts if part.path.name == file)
        written = part.table.filter(pc.field("trial") == trial).to_pylist()
        return next(row for row in written if row["status"] == status), origin(contents)(
            trial, file
        )
    return None


def path_of(contents: Contents, trial: int) -> list[dict[str, Any]]:
    """The steps that were kept of a trial: step, state, mean, cov (flat), control; empty where none were."""
    steps = [
        step
        for one in contents.paths
        for step in one.table.filter(pc.field("trial") == trial).to_pylist()
    ]
    return [step for _, step in sorted({step["step"]: step for step in steps}.items())]


def superseded(contents: Contents) -> str | None:
    """Why no command of today finds this cell, None if one does (or nothing of it can be read)."""
    config = contents.config
    if config is None:
        return None
    versions = {source.get("algorithm", ALGORITHM_VERSION) for source in contents.sources} - {
        ALGORITHM_VERSION
    }
    if versions:
        return (
            f"algorithm {', '.join(map(str, sorted(versions, key=str)))}, today {ALGORITHM_VERSION}"
        )
    missing = [key for key in IDENTITY if key not in config]
    return f"made before there was {missing[0]}" if missing else None


def belongs(config: dict[str, Any], folder: Path) -> bool:
    """Whether a configuration is that of the cell whose folder this is."""
    try:
        return Cell(config).id == folder.name
    except (KeyError, TypeError, ValueError):
        return False


def settings(contents: Contents) -> dict[str, Any]:
    """What tells this cell from others: the labels of its configuration, {} where they cannot be told."""
    config = contents.config or {}
    try:
        found = labels(config)
        how = {
            name: config.get(name) for name in ("precision", "platform", "batch") if name in config
        }
        return found | {"system": config["names"]["system"]} | how
    except (KeyError, TypeError, AttributeError):
        return {}


def counts(rows: pd.DataFrame) -> dict[str, int]:
    """Rows by status, good ones first."""
    found = {str(status): int(count) for status, count in rows["status"].value_counts().items()}
    return {
        status: found[status]
        for status in sorted(found, key=lambda status: (status != "ok", status))
    }
