"""Reads and writes single files of results: one folder per cell, files as a whole or not at all.

    <results_dir>/<cell>/part-*.parquet    a row per trial; the metadata says where it comes from
                         paths-*.parquet   a row per step of the first trials' trajectories
                         scene.json        what a picture needs to know
                         timing.json       the Time column
                         recording-*.json  one trial in detail, where asked for

Which trials are done is read from the part files and from nothing else. Only the leading process
writes. The metadata of a table is JSON under the key "mppi-belief":

    format    FORMAT_VERSION
    cell      the id of the cell, which is the name of its folder
    digest    a hash of all values
    sources   where the rows come from: {"trials": [[first, last], ...], ...} each
    seal      a hash of all these

`contents.py` reads a whole cell.
"""

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from ..errors import first_line
from .columns import COLUMN_TYPES, COLUMNS, PATH_TYPES
from .files import digest, write_whole
from .trial_ranges import ranges

FORMAT_VERSION = 3  # files of any other version are refused
READ_ATTEMPTS = 5  # at listing a folder whose files are merged at the same time
_METADATA_KEY = b"mppi-belief"
_SEAL = "seal"
_SCHEMAS = {"part": pa.schema(COLUMN_TYPES), "paths": pa.schema(PATH_TYPES)}


class ResultsFile(NamedTuple):
    """Holds a file that could be read."""

    path: Path
    metadata: dict[str, Any]  # format, cell, digest and sources, as above
    table: pa.Table  # first the columns that all files of its kind have, then the others


def write_rows(folder: Path, rows: Sequence[dict[str, Any]], *sources: dict[str, Any]) -> None:
    """Writes one part file with the rows of some trials; raises OSError.

    Each source says what the trials come from; several sources say which `trials` (ranges) each of
    them gave.
    """
    swept = [name for name in rows[0] if name not in COLUMN_TYPES]
    fields = [pa.field(name, kind) for name, kind in COLUMN_TYPES.items()]
    fields += [pa.field(name, pa.array([row[name] for row in rows]).type) for name in swept]
    table = pa.Table.from_pylist(list(rows), schema=pa.schema(fields))
    trials = ranges([row["trial"] for row in rows])
    write_table(folder, "part", table, [{"trials": trials, **source} for source in sources])


def write_paths(folder: Path, steps: Sequence[dict[str, Any]]) -> None:
    """Writes one file with the trajectories of some trials, a row per step; raises OSError."""
    numbers = ("trial", "step")
    columns = {
        name: pa.array([step[name] if name in numbers else step[name].tolist() for step in steps])
        for name in steps[0]
    }
    write_table(folder, "paths", pa.table(columns), [])


def write_table(
    folder: Path, kind: str, table: pa.Table, sources: Sequence[dict[str, Any]]
) -> Path:
    """Writes a file of one kind, "part" or "paths", named by its trials and its content; returns
    its path.
    """
    trials = table["trial"].to_pylist()
    content_digest = table_digest(table)
    metadata = {
        "format": FORMAT_VERSION,
        "cell": folder.name,
        "digest": content_digest,
        "sources": list(sources),
    }
    sealed = json.dumps({**metadata, _SEAL: digest(metadata)})
    described = table.replace_schema_metadata({_METADATA_KEY: sealed})
    path = folder / f"{kind}-{min(trials):06d}-{max(trials):06d}-{content_digest[:8]}.parquet"
    write_whole(
        path,
        lambda target: pq.write_table(
            described, target, compression="zstd", write_page_checksum=True
        ),
    )
    return path


def table_digest(table: pa.Table) -> str:
    """Returns a hash of the names and values of a table, numbers bit for bit."""
    content = hashlib.sha256()
    for name in sorted(table.column_names):
        column = table[name].combine_chunks()
        if pa.types.is_list(column.type):
            content.update(column.value_lengths().to_numpy(zero_copy_only=False).tobytes())
            column = column.flatten()
        content.update(f"{name} {column.type} {len(column)} ".encode())
        if pa.types.is_floating(column.type) or (
            pa.types.is_integer(column.type) and not column.null_count
        ):
            content.update(column.to_numpy(zero_copy_only=False).tobytes())
        else:
            content.update(json.dumps(column.to_pylist()).encode())
    return content.hexdigest()[:32]


def read_table(path: Path) -> tuple[dict[str, Any], pa.Table]:
    """Returns the metadata of a file and its table.

    Raises ValueError or OSError for a file that is torn, damaged, no results file, of another cell
    or format.
    """
    try:
        table = pq.ParquetFile(path, page_checksum_verification=True).read()
        metadata = json.loads((table.schema.metadata or {})[_METADATA_KEY])
        version = metadata["format"]
        seal = metadata.pop(_SEAL, None)
    except KeyError as error:
        raise ValueError("it has no metadata of mppi-belief") from error
    except (pa.ArrowException, TypeError, AttributeError) as error:
        raise ValueError(first_line(error)) from error
    if version != FORMAT_VERSION:
        raise ValueError(f"its format is {version}, must be {FORMAT_VERSION}")
    if seal != digest(metadata):
        raise ValueError("its metadata are not those that were written")
    if metadata.get("cell") != path.parent.name:
        raise ValueError(f"it belongs to {metadata.get('cell')}")
    if metadata.get("digest") != table_digest(table):
        raise ValueError("its values are not those that were written")
    if not _are_sources(metadata.get("sources")):
        raise ValueError("it does not say where its trials come from")
    return metadata, table


def _are_sources(sources: Any) -> bool:
    """Returns whether these are sources: each a dict whose `trials` are pairs of numbers."""
    if not isinstance(sources, list) or not all(isinstance(source, dict) for source in sources):
        return False
    return all(_are_ranges(source.get("trials")) for source in sources)


def _are_ranges(pairs: Any) -> bool:
    return isinstance(pairs, list) and all(
        isinstance(pair, list) and [type(part) for part in pair] == [int, int] for pair in pairs
    )


def read_files(folder: Path, kind: str, warn: Callable[[str], object]) -> list[ResultsFile]:
    """Returns the files of a cell of one kind, "part" or "paths", by name.

    A file that cannot be read is named to `warn` and left out. Files are listed again where one of
    them has gone, merged into another meanwhile.
    """
    for _ in range(READ_ATTEMPTS):
        readable: list[ResultsFile] = []
        warnings: list[str] = []
        gone = False
        for path in sorted(folder.glob(f"{kind}-*.parquet")):
            try:
                metadata, table = read_table(path)
                readable.append(ResultsFile(path, metadata, _known_first(table, _SCHEMAS[kind])))
            except (OSError, pa.ArrowException, KeyError, ValueError) as error:
                gone = gone or isinstance(error, FileNotFoundError)
                reason = first_line(error)
                warnings.append(f"{path}: not a results file of this cell, left out ({reason})")
        if not gone:
            break
    for line in warnings:
        warn(line)
    return readable


def _known_first(table: pa.Table, schema: pa.Schema) -> pa.Table:
    """Returns the columns of the schema in its types, then the others; raises KeyError or an Arrow
    exception.
    """
    known = table.select(schema.names).cast(schema)
    for name in table.column_names:
        if name not in schema.names:
            known = known.append_column(table.schema.field(name), table[name])
    return known


def result_hash(rows: pd.DataFrame) -> str:
    """Returns a hash of all columns of rows: equal if and only if the results are, bit for bit."""
    ordered = rows.sort_values("trial")[list(COLUMNS)]
    text = ordered.to_csv(index=False, float_format="%.17g", na_rep="none")
    return hashlib.sha256(text.encode()).hexdigest()[:16]
