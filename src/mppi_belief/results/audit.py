"""Whether the files of a cell say what was written, and agree with each other: `mppi-belief results verify`.

A file's own hash is checked where it is read (`results.table`, `results.files`). Here: every row
is of this cell and of a run that its file names, what is there twice is the same bit for bit, every path has its row.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import pandas as pd

from ..config.cell import labels
from .contents import Contents, belongs, superseded
from .table import COLUMNS, FINAL, Stored, in_words, ranges


def audit(contents: Contents) -> list[str]:
    """What is wrong with a cell, a line each that names the file or the trials; empty where nothing is."""
    return [
        *contents.problems,
        *_misplaced(contents),
        *disagreements(contents),
        *_steps_disagree(contents),
        *_loose_paths(contents),
    ]


def unhashed(contents: Contents) -> int:
    """The tables of format 1, which carry no hash: what is in them cannot be checked."""
    return sum("digest" not in one.about for one in (*contents.parts, *contents.paths))


def _misplaced(contents: Contents) -> Iterator[str]:
    """Rows of no run, and runs and rows of another cell."""
    current = superseded(contents) is None
    for part in contents.parts:
        configs = [source.get("config") for source in part.about["sources"]]
        if current and not all(
            isinstance(config, dict) and belongs(config, contents.folder) for config in configs
        ):
            yield f"{part.path}: its configuration is not that of this cell"
        said = [
            trial for source in part.about["sources"] for pair in source["trials"] for trial in pair
        ]
        inside, named = sorted(set(part.table["trial"].to_pylist())), _spread(part)
        if min([0, *inside, *said]) < 0 or named != ranges(inside):
            yield f"{part.path}: it has trials {_trials(inside)}, its runs {in_words(named, most=5)}"
        for column, values in _foreign(part, configs[0] if configs else None).items():
            yield f"{part.path}: {column} {values} in its rows is not that of its configuration"


def _spread(part: Stored) -> list[list[int]]:
    """The trials of all sources of a file, as ranges; overlapping ones stay apart."""
    found: list[list[int]] = []
    for first, last in sorted(
        pair for source in part.about["sources"] for pair in source["trials"]
    ):
        if found and first == found[-1][1] + 1:
            found[-1][1] = last
        else:
            found.append([first, last])
    return found


def _foreign(part: Stored, config: Any) -> dict[str, list[Any]]:
    """Settings in the rows that are not the configuration's, by column."""
    try:
        expected = labels(config)
    except (KeyError, TypeError, AttributeError):
        return {}
    found = {}
    for column in ("controller", "theta", "w_obs", "seed"):
        values = [
            value
            for value in part.table[column].unique().to_pylist()
            if not _same(value, expected[column])
        ]
        if values:
            found[column] = values
    return found


def _same(one: Any, other: Any) -> bool:
    return one == other or (one != one and other != other)


def disagreements(contents: Contents) -> list[str]:
    """Trials that more than one row says to have ended, and not the same way bit for bit."""
    return _differing(
        [part.table.select(COLUMNS).to_pandas() for part in contents.parts], ["trial"], "two rows"
    )


def _steps_disagree(contents: Contents) -> list[str]:
    return _differing(
        [one.table.to_pandas() for one in contents.paths], ["trial", "step"], "two paths"
    )


def _differing(frames: Sequence[pd.DataFrame], key: list[str], what: str) -> list[str]:
    if not frames:
        return []
    rows = pd.concat(frames, ignore_index=True)
    if "status" in rows:
        rows = rows[rows["status"].isin(FINAL)]
    twice = rows[rows.duplicated(key, keep=False)]
    bits = pd.Series(
        [repr(_plain(row)) for row in twice.to_dict("records")], index=twice.index, dtype=object
    )
    kinds = bits.groupby([twice[name] for name in key]).nunique()
    trials = sorted({int(at[0] if isinstance(at, tuple) else at) for at in kinds.index[kinds > 1]})
    return [f"trials {_trials(trials)}: {what} that differ"] if trials else []


def _plain(row: dict[Any, Any]) -> list[Any]:
    """The values of a row; the text of a float is another for every other float."""
    return [value.tolist() if hasattr(value, "tolist") else value for value in row.values()]


def _loose_paths(contents: Contents) -> Iterator[str]:
    """Trajectories without a row, and those that are not as long as their row says."""
    rows = contents.rows
    steps = dict(zip(rows["trial"], rows["steps"], strict=True)) if len(rows) else {}
    for one in contents.paths:
        frame = one.table.select(["trial", "step"]).to_pandas()
        found = {int(trial): sorted(group["step"]) for trial, group in frame.groupby("trial")}
        loose = [trial for trial in found if trial not in steps]
        if loose:
            yield f"{one.path}: trials {_trials(loose)} have no row (was a run killed? the same command goes on)"
        gaps = [
            trial
            for trial in found
            if trial in steps and found[trial] != [*range(steps[trial] + 1)]
        ]
        if gaps:
            yield f"{one.path}: trials {_trials(gaps)} have not the steps that their rows say"


def _trials(trials: Sequence[int]) -> str:
    return in_words(ranges(trials), most=5)
