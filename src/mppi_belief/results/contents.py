"""Reads the files of one cell.

This is the one reader of cells: `run`, `report`, `results`, `replay`, `compact` and `audit` use it.
A cell is read file by file, so that a row can be traced to its file and to its source
(`sources.py`): the run it comes from, with that run's configuration, command, commit and versions.
Nothing in these files is run, imported or unpickled.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from ..config.cell import ALGORITHM_VERSION, IDENTITY, Cell, labels
from .columns import COLUMNS, PATH_COLUMNS
from .files import read_json
from .table import ResultsFile, read_files

ALL_KINDS = ("paths", "part", "json")  # kinds of files, in the order in which they are read


@dataclass(frozen=True)
class CellContents:
    """Holds what could be read of a cell, and a line for every file that could not."""

    folder: Path
    paths: list[ResultsFile]  # its files of trajectories
    parts: list[ResultsFile]  # its part files
    notes: dict[str, dict[str, Any]]  # its JSON files by name, without the ending
    problems: list[str]  # what is wrong, a line each

    @property
    def sources(self) -> list[dict[str, Any]]:
        """Returns where the rows come from, in the order of the part files."""
        return [source for part in self.parts for source in part.metadata["sources"]]

    @property
    def config(self) -> dict[str, Any] | None:
        """Returns the configuration of the first source that has one."""
        configs = (source.get("config") for source in self.sources)
        return next((config for config in configs if isinstance(config, dict) and config), None)

    @cached_property
    def rows(self) -> pd.DataFrame:
        """Returns the rows, each trial once, by trial.

        Columns are `COLUMNS`, swept settings, and `_file`, the name of the row's part file.
        """
        frames = [part.table.to_pandas().assign(_file=part.path.name) for part in self.parts]
        if not frames:
            return pd.DataFrame(columns=[*COLUMNS, "_file"])
        return each_trial_once(pd.concat(frames, ignore_index=True))

    @cached_property
    def steps(self) -> pd.DataFrame:
        """Returns the trajectories (`PATH_COLUMNS`), each step once, by trial and step."""
        frames = [file.table.select(PATH_COLUMNS).to_pandas() for file in self.paths]
        if not frames:
            return pd.DataFrame(columns=list(PATH_COLUMNS))
        key = ["trial", "step"]
        return pd.concat(frames).drop_duplicates(key).sort_values(key, ignore_index=True)


def read_cell(folder: Path, kinds: tuple[str, ...] = ALL_KINDS) -> CellContents:
    """Reads the files of a cell, or those of some kinds.

    A file that cannot be read is left out, with a line in `problems`. Trajectories are read first:
    a run writes a trial's row after its path, so every row that is read has its path.
    """
    problems: list[str] = []
    paths = read_files(folder, "paths", problems.append) if "paths" in kinds else []
    parts = read_files(folder, "part", problems.append) if "part" in kinds else []
    notes = {}
    for path in sorted(folder.glob("[!.]*.json")) if "json" in kinds else ():
        content = read_json(folder, path.stem)
        if content is None:
            problems.append(f"{path}: not a file of ours, torn, or changed since it was written")
        else:
            notes[path.stem] = content
    return CellContents(folder, paths, parts, notes, problems)


def read_rows(folder: Path, warn: Callable[[str], object] = lambda line: None) -> pd.DataFrame:
    """Returns the rows of a cell (`COLUMNS`), each trial once.

    `warn` is called with a line for each file that cannot be read.
    """
    contents = read_cell(folder, ("part",))
    for line in contents.problems:
        warn(line)
    return contents.rows[list(COLUMNS)]


def each_trial_once(rows: pd.DataFrame) -> pd.DataFrame:
    """Returns rows by trial, each trial once.

    Of several rows of a trial the first good one counts, else the first, in the order of `_file`.
    """
    ordered = rows.assign(_bad=rows["status"] != "ok").sort_values(["trial", "_bad", "_file"])
    return ordered.drop_duplicates("trial", ignore_index=True).drop(columns="_bad")


def path_of(contents: CellContents, trial: int) -> list[dict[str, Any]]:
    """Returns the stored steps of a trial (`PATH_COLUMNS`) in order; empty if there are none."""
    steps = contents.steps
    records: Any = steps[steps["trial"] == trial].to_dict("records")
    return list(records)


def superseded(contents: CellContents) -> str | None:
    """Returns why no command of today finds this cell.

    None means that a command finds it, or that nothing of it can be read.
    """
    config = contents.config
    if config is None:
        return None
    versions = {source.get("algorithm", ALGORITHM_VERSION) for source in contents.sources}
    versions -= {ALGORITHM_VERSION}
    if versions:
        listed = ", ".join(map(str, sorted(versions, key=str)))
        return f"algorithm {listed}, today {ALGORITHM_VERSION}"
    missing = [key for key in IDENTITY if key not in config]
    return f"made before there was {missing[0]}" if missing else None


def belongs(config: dict[str, Any], folder: Path) -> bool:
    """Returns whether a configuration is that of the cell whose folder this is."""
    try:
        return Cell(config).id == folder.name
    except (KeyError, TypeError, ValueError):
        return False


def identifying_settings(contents: CellContents) -> dict[str, Any]:
    """Returns the settings that distinguish this cell from others.

    It is {} where the configuration lacks them.
    """
    config = contents.config or {}
    names = [name for name in ("precision", "platform", "batch") if name in config]
    try:
        system = {"system": config["names"]["system"]}
        return labels(config) | system | {name: config[name] for name in names}
    except (KeyError, TypeError, AttributeError):
        return {}


def status_counts(rows: pd.DataFrame) -> dict[str, int]:
    """Returns the number of rows by status, "ok" first."""
    counts = {str(status): int(count) for status, count in rows["status"].value_counts().items()}
    return {
        status: counts[status] for status in sorted(counts, key=lambda name: (name != "ok", name))
    }
