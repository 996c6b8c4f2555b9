"""Checks that the files of a cell say what was written, and agree with each other: `mppi-belief
results verify`.

The hash of a file is checked where it is read (`table.py`, `files.py`). Here: every row is of this
cell and of a run that its file names, what is there twice is the same bit for bit, and every path
has its row.
"""

import json
from collections.abc import Iterator, Sequence
from typing import Any

import pandas as pd

from ..config.cell import labels
from .columns import COLUMNS, FINAL_STATUSES
from .contents import CellContents, belongs, superseded
from .table import ResultsFile
from .trial_ranges import ranges, ranges_in_words

_CHECKED_LABELS = ("controller", "theta", "w_obs", "seed")


def audit(contents: CellContents) -> list[str]:
    """Returns what is wrong with a cell, a line each that names the file or the trials; empty where
    nothing is.
    """
    return [
        *contents.problems,
        *_misplaced(contents),
        *_mixed_settings(contents),
        *disagreements(contents),
        *_differing_steps(contents),
        *_paths_without_row(contents),
    ]


def _misplaced(contents: CellContents) -> Iterator[str]:
    """Yields rows of no run, and runs and rows of another cell."""
    current = superseded(contents) is None
    for part in contents.parts:
        configs = [source.get("config") for source in part.metadata["sources"]]
        if current and not all(
            isinstance(config, dict) and belongs(config, contents.folder) for config in configs
        ):
            yield f"{part.path}: its configuration is not that of this cell"

        named = _ranges_of_sources(part)
        trials = sorted(set(part.table["trial"].to_pylist()))
        least = min((first for first, _ in named), default=0)
        if min([0, least, *trials]) < 0 or named != ranges(trials):
            yield (
                f"{part.path}: it has trials {_in_words(trials)},"
                f" its runs {ranges_in_words(named, most=5)}"
            )
        for column, values in _foreign_labels(part, configs[0] if configs else None).items():
            yield f"{part.path}: {column} {values} in its rows is not that of its configuration"


def _mixed_settings(contents: CellContents) -> Iterator[str]:
    """Yields a line for a cell whose trials were computed with different settings, which may change
    the digits of a number.

    Sources without settings are of trials whose worker died, or of an earlier version.
    """
    trials: dict[str, list[list[int]]] = {}
    for source in contents.sources:
        if isinstance(source.get("settings"), dict):
            text = json.dumps(source["settings"], sort_keys=True)
            trials.setdefault(text, []).extend(source["trials"])
    if len(trials) > 1:
        parts = [
            f"trials {ranges_in_words(sorted(pairs), most=5)} with {text}"
            for text, pairs in trials.items()
        ]
        yield f"trials were computed with different settings: {'; '.join(parts)}"


def _ranges_of_sources(part: ResultsFile) -> list[list[int]]:
    """Returns the trials of all sources of a file as ranges; overlapping ranges stay apart."""
    pairs: list[list[int]] = []
    for source in part.metadata["sources"]:
        pairs += source["trials"]
    merged: list[list[int]] = []
    for first, last in sorted(pairs):
        if merged and first == merged[-1][1] + 1:
            merged[-1][1] = last
        else:
            merged.append([first, last])
    return merged


def _foreign_labels(part: ResultsFile, config: Any) -> dict[str, list[Any]]:
    """Returns settings in the rows that are not those of the configuration, by column."""
    try:
        expected = labels(config)
    except (KeyError, TypeError, AttributeError):
        return {}
    foreign = {}
    for column in _CHECKED_LABELS:
        values = part.table[column].unique().to_pylist()
        wrong = [value for value in values if not same_value(value, expected[column])]
        if wrong:
            foreign[column] = wrong
    return foreign


def same_value(first: Any, second: Any) -> bool:
    """Returns whether two values are equal or both not a number."""
    return first == second or (first != first and second != second)


def disagreements(contents: CellContents) -> list[str]:
    """Returns a line on trials that ended in more than one way, bit for bit, by several final rows;
    [] without any.
    """
    frames = [part.table.select(COLUMNS).to_pandas() for part in contents.parts]
    if not frames:
        return []
    rows = pd.concat(frames, ignore_index=True)
    return _differing(rows[rows["status"].isin(FINAL_STATUSES)], ["trial"], "two rows")


def _differing_steps(contents: CellContents) -> list[str]:
    frames = [file.table.to_pandas() for file in contents.paths]
    if not frames:
        return []
    return _differing(pd.concat(frames, ignore_index=True), ["trial", "step"], "two paths")


def _differing(rows: pd.DataFrame, key: list[str], what: str) -> list[str]:
    """Returns a line on the trials that have several rows of one key whose values differ; []
    without any.
    """
    repeated = rows[rows.duplicated(key, keep=False)]
    texts = [repr(_row_values(row)) for row in repeated.to_dict("records")]
    by_key = pd.Series(texts, index=repeated.index, dtype=object).groupby(
        [repeated[name] for name in key]
    )
    counts = by_key.nunique()
    keys = counts.index[counts > 1]
    trials = sorted({int(value[0] if isinstance(value, tuple) else value) for value in keys})
    return [f"trials {_in_words(trials)}: {what} that differ"] if trials else []


def _row_values(row: dict[Any, Any]) -> list[Any]:
    """Returns the values of a row as Python objects, whose texts differ for different floats."""
    return [value.tolist() if hasattr(value, "tolist") else value for value in row.values()]


def _paths_without_row(contents: CellContents) -> Iterator[str]:
    """Yields trajectories without a row, and those that are not as long as their row says."""
    rows = contents.rows
    steps_of = dict(zip(rows["trial"], rows["steps"], strict=True)) if len(rows) else {}
    for file in contents.paths:
        frame = file.table.select(["trial", "step"]).to_pandas()
        steps = {int(trial): sorted(group["step"]) for trial, group in frame.groupby("trial")}
        without_row = [trial for trial in steps if trial not in steps_of]
        if without_row:
            yield (
                f"{file.path}: trials {_in_words(without_row)} have no row"
                " (was a run killed? the same command goes on)"
            )
        known = [trial for trial in steps if trial in steps_of]
        wrong = [trial for trial in known if steps[trial] != [*range(steps_of[trial] + 1)]]
        if wrong:
            yield f"{file.path}: trials {_in_words(wrong)} have not the steps that their rows say"


def _in_words(trials: Sequence[int]) -> str:
    return ranges_in_words(ranges(trials), most=5)
