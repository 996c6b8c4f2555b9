"""Results that outlive an interruption: one folder a cell, parquet files written whole or not at all.

    <results_dir>/<cell>/part-*.parquet    a row per trial; the schema's metadata says where it comes from
                         paths-*.parquet   a row per step of the first trials' trajectories
                         scene.json        what a picture needs to know
                         timing.json       the Time column
                         recording-*.json  one trial in detail, where asked for

Which trials are done is read from the part files and from nothing else. Only the parent process writes. A table's
metadata is JSON under the key "mppi-belief":

    format    FORMAT_VERSION      cell      the cell's id, the name of its folder
    digest    of all values       sources   where the rows come from: {"trials": [[first, last], ...], ...} each
    seal      of all these

Format 1 had one source, its keys beside `format`, and neither a digest nor the cell's id; trajectories had no metadata.
Formats 1 and 2 had no columns `nees` and `nis`; these are empty where such a file is read.
"""

import hashlib
import json
from bisect import bisect_left
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from .files import digest, write_whole

FORMAT_VERSION = 3
ATTEMPTS = 5  # at listing a folder whose files are merged at the same time
_KEY, _SEAL = b"mppi-belief", "seal"
_TYPES: dict[str, pa.DataType] = {
    "trial": pa.int64(),
    "seed": pa.int64(),
    "status": pa.string(),
    "controller": pa.string(),
    "theta": pa.float64(),
    "w_obs": pa.float64(),
    "cost": pa.float64(),
    "running_cost": pa.float64(),
    "terminal_cost": pa.float64(),
    "collided": pa.bool_(),
    "clearance": pa.float64(),
    "final_distance": pa.float64(),
    "ess": pa.float64(),
    "nees": pa.float64(),
    "nis": pa.float64(),
    "steps": pa.int64(),
    "error": pa.string(),
}
COLUMNS = (*_TYPES,)  # that the rows of all cells have; others are swept settings
_SINCE_3 = ("nees", "nis")
_ROWS = pa.schema(list(_TYPES.items()))
_NUMBERS = pa.list_(pa.float64())
_PATHS = pa.schema(
    {
        "trial": pa.int64(),
        "step": pa.int64(),
        **dict.fromkeys(("state", "mean", "cov", "control"), _NUMBERS),
    }
)


def write_rows(folder: Path, rows: Sequence[dict[str, Any]], *sources: dict[str, Any]) -> None:
    """One part file for these trials; of several sources each says which `trials` (ranges) it gave."""
    extra = [name for name in rows[0] if name not in _TYPES]
    columns = [pa.field(name, kind) for name, kind in _TYPES.items()]
    columns += [pa.field(name, pa.array([row[name] for row in rows]).type) for name in extra]
    table = pa.Table.from_pylist(list(rows), schema=pa.schema(columns))
    every = ranges([row["trial"] for row in rows])
    write_table(folder, "part", table, [{"trials": every, **source} for source in sources])


def write_paths(folder: Path, rows: Sequence[dict[str, Any]]) -> None:
    """One file with the trajectories of these trials."""
    table = pa.table(
        {
            name: pa.array(
                [row[name] if name in ("trial", "step") else row[name].tolist() for row in rows]
            )
            for name in rows[0]
        }
    )
    write_table(folder, "paths", table, [])


def write_table(
    folder: Path, kind: str, table: pa.Table, sources: Sequence[dict[str, Any]]
) -> Path:
    """A file of one kind, "part" or "paths", named by its trials and its content; the path it has."""
    trials, content = table["trial"].to_pylist(), table_digest(table)
    about = {
        "format": FORMAT_VERSION,
        "cell": folder.name,
        "digest": content,
        "sources": list(sources),
    }
    told = table.replace_schema_metadata({_KEY: json.dumps({**about, _SEAL: digest(about)})})
    path = folder / f"{kind}-{min(trials):06d}-{max(trials):06d}-{content[:8]}.parquet"
    write_whole(
        path,
        lambda place: pq.write_table(told, place, compression="zstd", write_page_checksum=True),
    )
    return path


def table_digest(table: pa.Table) -> str:
    """A hash of the names and values of a table, numbers bit for bit."""
    found = hashlib.sha256()
    for name in sorted(table.column_names):
        column = table[name].combine_chunks()
        if pa.types.is_list(column.type):
            found.update(column.value_lengths().to_numpy(zero_copy_only=False).tobytes())
            column = column.flatten()
        found.update(f"{name} {column.type} {len(column)} ".encode())
        if pa.types.is_floating(column.type) or (
            pa.types.is_integer(column.type) and not column.null_count
        ):
            found.update(column.to_numpy(zero_copy_only=False).tobytes())
        else:
            found.update(json.dumps(column.to_pylist()).encode())
    return found.hexdigest()[:32]


def ranges(trials: Collection[int]) -> list[list[int]]:
    """Trials as [first, last] of every run without a gap."""
    found: list[list[int]] = []
    for trial in sorted(trials):
        if found and trial == found[-1][1] + 1:
            found[-1][1] = trial
        else:
            found.append([trial, trial])
    return found


def in_words(pairs: Sequence[Sequence[int]], most: int | None = None) -> str:
    """Ranges of trials, the first so many of them: "0..9, 12 and 3 more"."""
    told = [str(first) if first == last else f"{first}..{last}" for first, last in pairs]
    more = len(told) - len(told[:most])
    return ", ".join(told[:most]) + (f" and {more} more" if more else "") or "none"


def _ignore(line: str) -> None:
    """Nobody to tell."""


def read_table(path: Path) -> tuple[dict[str, Any], pa.Table]:
    """What a file says of itself (in today's format) and its table; raises ValueError or OSError for a file that is
    torn, damaged, not one of ours, another cell's, or of a newer format."""
    try:
        table = pq.ParquetFile(path, page_checksum_verification=True).read()
        about = json.loads(_told(path, table))
        version = int(about["format"])
    except (pa.ArrowException, KeyError, TypeError) as error:
        raise ValueError((str(error).splitlines() or [""])[0]) from error
    if about.pop(_SEAL, None) not in (None, digest(about)):
        raise ValueError("what it says of itself is not what was written")
    if version == 1:
        trials = table["trial"].to_pylist() if "trial" in table.column_names else []
        sources = (
            [{"trials": ranges(set(trials)), **about}] if path.name.startswith("part-") else []
        )
        about = {"format": 1, "sources": sources}
    if version > FORMAT_VERSION:
        raise ValueError(f"format {version} is of a newer mppi-belief")
    if about.get("cell", path.parent.name) != path.parent.name:
        raise ValueError(f"it belongs to {about['cell']}")
    if about.get("digest", content := table_digest(table)) != content:
        raise ValueError("its values are not those that were written")
    if not _are_sources(about.get("sources")):
        raise ValueError("it does not say where its trials come from")
    return about, table


def _told(path: Path, table: pa.Table) -> bytes:
    """The metadata of a table; in format 1 trajectories had none."""
    about = (table.schema.metadata or {}).get(_KEY)
    if about is None and path.name.startswith("paths-"):
        return b'{"format": 1}'
    if about is None:
        raise ValueError("it has no metadata of mppi-belief")
    return about


def _are_sources(found: Any) -> bool:
    """Whether these are sources: each a dict whose `trials` are pairs of numbers."""
    trials = [source.get("trials") if isinstance(source, dict) else None for source in found or ()]
    if not isinstance(found, list) or not all(isinstance(one, list) for one in trials):
        return False
    pairs = [pair for one in trials for pair in one or ()]
    return all(
        isinstance(pair, list) and [type(part) for part in pair] == [int, int] for pair in pairs
    )


class Stored(NamedTuple):
    """A file that could be read: what it says of itself, and its table, first the columns that all files have."""

    path: Path
    about: dict[str, Any]
    table: pa.Table


def read_parts(folder: Path, warn: Callable[[str], object] = _ignore) -> list[Stored]:
    """The part files of a cell by name; one that cannot be read is named to `warn` and left out."""
    return _read(folder, "part", _ROWS, warn)


def read_steps(folder: Path, warn: Callable[[str], object] = _ignore) -> list[Stored]:
    """The same of the files with trajectories."""
    return _read(folder, "paths", _PATHS, warn)


def _read(
    folder: Path, kind: str, schema: pa.Schema, warn: Callable[[str], object]
) -> list[Stored]:
    """The files of one kind. They are listed anew where one of them has gone, merged into another meanwhile."""
    for _ in range(ATTEMPTS):
        paths, found, lines, gone = sorted(folder.glob(f"{kind}-*.parquet")), [], [], False
        for path in paths:
            try:
                about, table = read_table(path)
                found.append(Stored(path, about, _known_first(table, schema)))
            except (OSError, pa.ArrowException, KeyError, ValueError) as error:
                gone = gone or isinstance(error, FileNotFoundError)
                reason = (str(error).splitlines() or [""])[0]
                lines.append(f"{path}: not a results file of this cell, left out ({reason})")
        if not gone:
            break
    for line in lines:
        warn(line)
    return found


def _known_first(table: pa.Table, schema: pa.Schema) -> pa.Table:
    """The columns of the schema in its types, then the others; raises KeyError or an Arrow exception. What an older
    format did not have is empty."""
    for name in [
        name for name in _SINCE_3 if name in schema.names and name not in table.column_names
    ]:
        table = table.append_column(name, pa.nulls(len(table), schema.field(name).type))
    others = [name for name in table.column_names if name not in schema.names]
    known = table.select(schema.names).cast(schema)
    for name in others:
        known = known.append_column(table.schema.field(name), table[name])
    return known


def read_rows(folder: Path, warn: Callable[[str], object] = _ignore) -> pd.DataFrame:
    """The rows of a cell by trial, each trial once; a file that cannot be read is named to `warn` and left out."""
    return rows_of(read_parts(folder, warn))


def rows_of(parts: Sequence[Stored]) -> pd.DataFrame:
    """The rows of part files by trial, each trial once."""
    frames = [
        part.table.select(_ROWS.names).to_pandas().assign(_file=part.path.name) for part in parts
    ]
    if not frames:
        return pd.DataFrame(columns=[*_TYPES])
    return each_once(pd.concat(frames, ignore_index=True)).drop(columns="_file")


def each_once(rows: pd.DataFrame) -> pd.DataFrame:
    """By trial, of several rows of one the first good one, else the first; `_file` says where a row was found."""
    rows = rows.assign(_bad=rows["status"] != "ok").sort_values(["trial", "_bad", "_file"])
    return rows.drop_duplicates("trial", ignore_index=True).drop(columns="_bad")


def read_paths(folder: Path, warn: Callable[[str], object] = _ignore) -> pd.DataFrame:
    """The kept trajectories of a cell by trial and step."""
    frames = [one.table.select(_PATHS.names).to_pandas() for one in read_steps(folder, warn)]
    if not frames:
        return pd.DataFrame(columns=_PATHS.names)
    return (
        pd.concat(frames)
        .drop_duplicates(["trial", "step"])
        .sort_values(["trial", "step"], ignore_index=True)
    )


def sources_of(parts: Sequence[Stored], trials: Collection[int]) -> list[dict[str, Any]]:
    """Where these trials come from: the sources in part files that hold one of them."""
    wanted = sorted(trials)
    sources = [source for part in parts for source in part.about["sources"]]
    return [source for source in sources if _holds(source["trials"], wanted)]


def _holds(within: Sequence[Sequence[int]], trials: Sequence[int]) -> bool:
    """Whether one of the trials (ascending) lies in one of the ranges."""
    places = ((bisect_left(trials, first), last) for first, last in within)
    return any(at < len(trials) and trials[at] <= last for at, last in places)


def result_hash(rows: pd.DataFrame) -> str:
    """A hash of everything in the rows: equal if and only if the results are, bit for bit."""
    ordered = rows.sort_values("trial")[[*_TYPES]]
    return hashlib.sha256(
        ordered.to_csv(index=False, float_format="%.17g", na_rep="none").encode()
    ).hexdigest()[:16]


FINAL = ("ok", "diverged")  # how a trial ends by itself: the same configuration ends it the same
