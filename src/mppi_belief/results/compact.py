"""Merges the many small files of a cell into one of each kind: `mppi-belief results compact`.

The new file is written as a whole before the files that it was made of are removed, and no others
are: killed at any instant, or beside a run that adds files, the folder holds every row at least
once, and readers take each trial once.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from .audit import disagreements
from .contents import CellContents, each_trial_once, read_cell
from .folder import cell_files, leftovers, total_size
from .sources import runs
from .table import ResultsFile, read_table, result_hash, table_digest, write_table

STALE = 3600.0  # s: no file takes that long to be written


class Compacted(NamedTuple):
    """Says what was merged of a cell."""

    files: tuple[int, int]  # number of files before and after
    bytes: tuple[int, int]  # their size before and after
    problems: list[str]  # why something was left as it was, a line each


def compact(folder: Path) -> Compacted:
    """Merges the files of a cell; leaves what cannot be read where it is.

    Raises OSError where it cannot write.
    """
    before = cell_files(folder)
    size_before = total_size(before)
    contents = read_cell(folder)
    problems = [*contents.problems]
    differing = disagreements(contents)
    if differing:
        problems += [f"{folder}: left as it is: {line}" for line in differing]
    else:
        _merge_parts(contents)
        _merge_paths(contents)
        for path in leftovers(folder, STALE):
            path.unlink(missing_ok=True)
    after = cell_files(folder)
    return Compacted((len(before), len(after)), (size_before, total_size(after)), problems)


def _merge_parts(contents: CellContents) -> None:
    """Writes one part file with each trial once, and the sources of just these rows."""
    if not contents.parts:
        return
    every = _concatenated(contents.parts)
    index = every.select(["trial", "status"]).to_pandas()
    index = index.assign(_file=_file_names(contents.parts), _position=range(len(every)))
    table = every.take(pa.array(each_trial_once(index)["_position"]))
    sources = runs(contents, contents.rows)
    if _needs_writing(contents.parts, table, sources):
        path = write_table(contents.folder, "part", table, sources)
        same = result_hash(read_table(path)[1].to_pandas()) == result_hash(contents.rows)
        _check_written(path, same)
        _remove_merged(contents.parts, path)


def _merge_paths(contents: CellContents) -> None:
    """Writes one file of trajectories with each step once.

    Trajectories without a row stay, too: a run may be about to add the row.
    """
    if not contents.paths:
        return
    key = ["trial", "step"]
    every = _concatenated(contents.paths)
    index = every.select(key).to_pandas().assign(_position=range(len(every)))
    index = index.drop_duplicates(key).sort_values(key)
    table = every.take(pa.array(index["_position"]))
    if _needs_writing(contents.paths, table, []):
        path = write_table(contents.folder, "paths", table, [])
        _check_written(path, table_digest(read_table(path)[1]) == table_digest(table))
        _remove_merged(contents.paths, path)


def _concatenated(files: Sequence[ResultsFile]) -> pa.Table:
    """Returns the tables of some files, one after the other; a column that a file lacks is empty
    there.
    """
    tables = [file.table.replace_schema_metadata() for file in files]
    return pa.concat_tables(tables, promote_options="default")


def _file_names(files: Sequence[ResultsFile]) -> list[str]:
    """Returns the name of the file of every row of these tables together."""
    names: list[str] = []
    for file in files:
        names += [file.path.name] * len(file.table)
    return names


def _check_written(path: Path, same: bool) -> None:
    if not same:
        raise OSError(f"{path} reads back with other rows than were written; no file was removed")


def _needs_writing(
    files: Sequence[ResultsFile], table: pa.Table, sources: Sequence[dict[str, Any]]
) -> bool:
    """Returns whether a merged file would say anything else than the one that is there."""
    metadata = files[0].metadata
    unchanged = (metadata["digest"], metadata["sources"]) == (table_digest(table), list(sources))
    return len(files) > 1 or not unchanged


def _remove_merged(files: Sequence[ResultsFile], merged: Path) -> None:
    """Removes the files that were read, but not the new one."""
    for file in files:
        if file.path != merged:
            file.path.unlink(missing_ok=True)
