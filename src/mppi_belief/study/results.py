"""Results that outlive an interruption: one folder a cell, parquet files written whole or not at all.

    <results_dir>/<cell>/part-*.parquet    a row per trial; the schema's metadata says where it comes from
                         paths-*.parquet   a row per step of the first trials' trajectories
                         scene.json        what a picture needs to know
                         timing.json       the Time column
                         recording-*.json  one trial in detail, where asked for

Which trials are done is read from the part files and from nothing else. Only the parent process writes.
"""

import hashlib
import json
import os
import tempfile
from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

FORMAT_VERSION = 1
_KEY = b"mppi-belief"
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
    "steps": pa.int64(),
    "error": pa.string(),
}
_ROWS = pa.schema(list(_TYPES.items()))
_NUMBERS = pa.list_(pa.float64())
_PATHS = pa.schema(
    {"trial": pa.int64(), "step": pa.int64(), **dict.fromkeys(("state", "mean", "cov", "control"), _NUMBERS)}
)


def probe(root: Path) -> None:
    """Raise OSError if `root` cannot be made or written to."""
    root.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=root):
        pass


def write_rows(folder: Path, rows: Sequence[dict[str, Any]], provenance: dict[str, Any]) -> None:
    """One part file for these trials."""
    extra = [name for name in rows[0] if name not in _TYPES]
    columns = [pa.field(name, kind) for name, kind in _TYPES.items()]
    columns += [pa.field(name, pa.array([row[name] for row in rows]).type) for name in extra]
    schema = pa.schema(columns, metadata={_KEY: json.dumps({"format": FORMAT_VERSION, **provenance})})
    _write_table(folder, "part", rows, pa.Table.from_pylist(list(rows), schema=schema))


def write_paths(folder: Path, rows: Sequence[dict[str, Any]]) -> None:
    """One file with the trajectories of these trials."""
    table = pa.table(
        {
            name: pa.array([row[name] if name in ("trial", "step") else row[name].tolist() for row in rows])
            for name in rows[0]
        }
    )
    _write_table(folder, "paths", rows, table)


def write_json(folder: Path, name: str, content: Any) -> None:
    """A small file beside the tables."""
    write_whole(folder / f"{name}.json", lambda path: path.write_text(json.dumps(content)))


def _write_table(folder: Path, kind: str, rows: Sequence[dict[str, Any]], table: pa.Table) -> None:
    trials = sorted({row["trial"] for row in rows})
    digest = hashlib.sha256(repr(trials).encode()).hexdigest()[:8]
    name = f"{kind}-{trials[0]:06d}-{trials[-1]:06d}-{digest}.parquet"
    write_whole(folder / name, lambda path: pq.write_table(table, path, compression="zstd"))


def write_whole(target: Path, fill: Callable[[Path], Any]) -> None:
    """Let `fill` write a temporary file, fsync, rename: a reader sees all of it or nothing, also after a power cut."""
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f".tmp-{os.getpid()}-{target.name}")
    try:
        fill(temporary)
        _sync(temporary)
        temporary.replace(target)
        _sync(target.parent)
    finally:
        temporary.unlink(missing_ok=True)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _ignore(line: str) -> None:
    """Nobody to tell."""


def _read(folder: Path, kind: str, schema: pa.Schema, warn: Callable[[str], object]) -> Iterator[pd.DataFrame]:
    """The tables of one kind, by file name; a file that cannot be read is named to `warn` and left out."""
    for path in sorted(folder.glob(f"{kind}-*.parquet")):
        try:
            table = pq.ParquetFile(path).read().select(schema.names).cast(schema)
            yield table.to_pandas().assign(_file=path.name)
        except (OSError, pa.ArrowException, KeyError, ValueError) as error:
            warn(f"{path}: not a results file, left out ({(str(error).splitlines() or [''])[0]})")


def read_rows(folder: Path, warn: Callable[[str], object] = _ignore) -> pd.DataFrame:
    """The rows of a cell by trial, each trial once; a file that cannot be read is named to `warn` and left out."""
    frames = list(_read(folder, "part", _ROWS, warn))
    if not frames:
        return pd.DataFrame(columns=[*_TYPES])
    rows = pd.concat(frames, ignore_index=True)
    rows["_bad"] = rows["status"] != "ok"
    rows = rows.sort_values(["trial", "_bad", "_file"]).drop_duplicates("trial", ignore_index=True)
    return rows.drop(columns=["_file", "_bad"])


def read_paths(folder: Path, warn: Callable[[str], object] = _ignore) -> pd.DataFrame:
    """The kept trajectories of a cell by trial and step."""
    frames = list(_read(folder, "paths", _PATHS, warn))
    if not frames:
        return pd.DataFrame(columns=_PATHS.names)
    paths = pd.concat(frames).drop_duplicates(["trial", "step"]).sort_values(["trial", "step"], ignore_index=True)
    return paths.drop(columns="_file")


def read_sources(folder: Path, trials: Collection[int]) -> list[dict[str, Any]]:
    """What each readable part file with some of these trials says of where it comes from."""
    found, wanted = [], set(trials)
    for path in sorted(folder.glob("part-*.parquet")):
        try:
            file = pq.ParquetFile(path)
            source, held = _provenance(file.schema_arrow), file.read(columns=["trial"])["trial"].to_pylist()
        except (OSError, pa.ArrowException, KeyError, TypeError, ValueError):
            continue  # `read_rows` names it
        if isinstance(source, dict) and wanted.intersection(held):
            found.append(source)
    return found


def read_provenance(path: Path) -> dict[str, Any]:
    """What a part file says of where it comes from."""
    return _provenance(pq.read_schema(path))


def _provenance(schema: pa.Schema) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(schema.metadata[_KEY])
    return found


def read_json(folder: Path, name: str) -> Any:
    """A small file beside the tables, or None."""
    try:
        return json.loads((folder / f"{name}.json").read_text())
    except (OSError, ValueError):
        return None


def result_hash(rows: pd.DataFrame) -> str:
    """A hash of everything in the rows: equal if and only if the results are, bit for bit."""
    ordered = rows.sort_values("trial")[[*_TYPES]]
    return hashlib.sha256(ordered.to_csv(index=False, float_format="%.17g", na_rep="none").encode()).hexdigest()[:16]
