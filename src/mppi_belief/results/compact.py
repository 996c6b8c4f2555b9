"""Many small files of a cell become one of each kind: `mppi-belief results compact`.

The new file is written whole before the files it was made of are removed, and no others are: killed at any instant,
or beside a run that adds files, the folder holds every row at least once, and readers take each trial once.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from .audit import disagreements
from .contents import Contents, read_cell, runs
from .folder import files, leftovers, size
from .table import (
    FORMAT_VERSION,
    Stored,
    each_once,
    read_table,
    result_hash,
    table_digest,
    write_table,
)

STALE = 3600.0  # s: no file takes that long to be written


class Compacted(NamedTuple):
    """Files and bytes of a cell before and after, and why something was left as it was, a line each."""

    files: tuple[int, int]
    bytes: tuple[int, int]
    problems: list[str]


def compact(folder: Path) -> Compacted:
    """Merge the files of a cell; raises OSError where it cannot write. What cannot be read is left where it is."""
    before, contents = files(folder), read_cell(folder)
    were, problems = size(before), [*contents.problems]
    differing = disagreements(contents)
    if differing:
        problems += [f"{folder}: left as it is: {line}" for line in differing]
    else:
        _merge_parts(contents)
        _merge_paths(contents)
        for path in leftovers(folder, STALE):
            path.unlink(missing_ok=True)
    after = files(folder)
    return Compacted((len(before), len(after)), (were, size(after)), problems)


def _merge_parts(contents: Contents) -> None:
    """One part file with each trial once, and the sources of just these rows."""
    if not contents.parts:
        return
    every, rows = _together(contents.parts), contents.rows
    places = (
        every.select(["trial", "status"])
        .to_pandas()
        .assign(_file=_names(contents.parts), _at=range(len(every)))
    )
    table, sources = every.take(pa.array(each_once(places)["_at"])), runs(contents, rows)
    if _needed(contents.parts, table, sources):
        made = write_table(contents.folder, "part", table, sources)
        _check(made, result_hash(read_table(made)[1].to_pandas()) == result_hash(rows))
        _remove(contents.parts, made)


def _merge_paths(contents: Contents) -> None:
    """One file of trajectories with each step once, those of trials without a row too: a run may be about to add it."""
    if not contents.paths:
        return
    every, key = _together(contents.paths), ["trial", "step"]
    places = (
        every.select(key)
        .to_pandas()
        .assign(_at=range(len(every)))
        .drop_duplicates(key)
        .sort_values(key)
    )
    table = every.take(pa.array(places["_at"]))
    if _needed(contents.paths, table, []):
        made = write_table(contents.folder, "paths", table, [])
        _check(made, table_digest(read_table(made)[1]) == table_digest(table))
        _remove(contents.paths, made)


def _together(stored: Sequence[Stored]) -> pa.Table:
    """The tables of some files, one after the other; what a file has no column for is empty."""
    return pa.concat_tables(
        [one.table.replace_schema_metadata() for one in stored], promote_options="default"
    )


def _names(stored: Sequence[Stored]) -> list[str]:
    """The file of every row of these tables together."""
    return [one.path.name for one in stored for _ in range(len(one.table))]


def _check(made: Path, good: bool) -> None:
    if not good:
        raise OSError(f"{made} does not read back as what it was made of; nothing was removed")


def _needed(stored: Sequence[Stored], table: pa.Table, sources: Sequence[dict[str, Any]]) -> bool:
    """Whether a merged file would say anything else than the one that is there."""
    about = stored[0].about
    there = (about["format"], about.get("digest"), about["sources"])
    return len(stored) > 1 or there != (FORMAT_VERSION, table_digest(table), list(sources))


def _remove(stored: Sequence[Stored], made: Path) -> None:
    """Remove what was read, but not the new file."""
    for one in stored:
        if one.path != made:
            one.path.unlink(missing_ok=True)
