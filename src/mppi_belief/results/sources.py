"""Traces the rows of a cell to their sources: the runs that computed them.

A source is a dict in the metadata of a part file: its `trials` (ranges), configuration, command,
commit, versions, machine, and the seconds `elapsed` since the run began.
"""

import json
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Collection
from typing import Any

import pandas as pd
import pyarrow.compute as pc

from .contents import CellContents
from .trial_ranges import ranges

_NOT_OF_THE_RUN = ("trials", "elapsed")  # these differ between the sources of one run


def source_finder(contents: CellContents) -> Callable[[int, str], dict[str, Any]]:
    """Returns a function (trial, name of a part file) -> source of that row; {} where no source has
    the trial.
    """
    spans: dict[str, list[tuple[int, int, dict[str, Any]]]] = {}
    for part in contents.parts:
        spans[part.path.name] = []
        for source in part.metadata["sources"]:
            spans[part.path.name] += [(first, last, source) for first, last in source["trials"]]
        spans[part.path.name].sort(key=lambda span: span[:2])
    unknown: dict[str, Any] = {}

    def find(trial: int, file: str) -> dict[str, Any]:
        position = bisect_right(spans[file], trial, key=lambda span: span[0]) - 1
        if position < 0:
            return unknown
        _, last, source = spans[file][position]
        return source if trial <= last else unknown

    return find


def runs(contents: CellContents, rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Returns one source for each run, with just the trials of these rows and the longest time
    since its start.

    `rows` have `_file` as in `CellContents.rows`. Sources are of one run where all but trials and
    times agree.
    """
    find_source = source_finder(contents)
    keys: dict[int, str] = {}  # by identity, since rows of one source share the very same dict
    common: dict[str, dict[str, Any]] = {}
    trials: dict[str, list[int]] = {}
    times: dict[str, list[float]] = {}
    for trial, file in zip(rows["trial"], rows["_file"], strict=True):
        source = find_source(trial, file)
        if id(source) not in keys:
            run = {name: value for name, value in source.items() if name not in _NOT_OF_THE_RUN}
            key = json.dumps(run, sort_keys=True)
            keys[id(source)] = key
            common.setdefault(key, run)
            trials.setdefault(key, [])
            times.setdefault(key, []).extend([source["elapsed"]] if "elapsed" in source else [])
        trials[keys[id(source)]].append(trial)
    merged = []
    for key, run in common.items():
        elapsed = {"elapsed": max(times[key])} if times[key] else {}
        merged.append({"trials": ranges(trials[key]), **run, **elapsed})
    return merged


def row_of(contents: CellContents, trial: int) -> tuple[dict[str, Any], dict[str, Any]] | None:
    """Returns the row of a trial as it was written and its source; None where there is none."""
    rows = contents.rows
    chosen = rows[rows["trial"] == trial]
    if chosen.empty:
        return None
    file = str(chosen["_file"].iloc[0])
    status = chosen["status"].iloc[0]
    (part,) = (part for part in contents.parts if part.path.name == file)
    written = part.table.filter(pc.field("trial") == trial).to_pylist()
    row = next(row for row in written if row["status"] == status)
    return row, source_finder(contents)(trial, file)


def sources_of(contents: CellContents, trials: Collection[int]) -> list[dict[str, Any]]:
    """Returns the sources that have one of these trials, in the order of the part files."""
    wanted = sorted(trials)
    return [source for source in contents.sources if _has_any(source["trials"], wanted)]


def _has_any(pairs: list[list[int]], trials: list[int]) -> bool:
    """Returns whether one of the trials (ascending) lies in one of the ranges."""
    for first, last in pairs:
        position = bisect_left(trials, first)
        if position < len(trials) and trials[position] <= last:
            return True
    return False
