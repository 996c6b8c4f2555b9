"""What rows cost on disk, and what it takes to read a million of them, by how many of them a part file has."""

import time
from pathlib import Path
from typing import Any

import numpy as np

import rounds
from mppi_belief.results import table as results

from .sizes import Sizes

MILLION = 1_000_000
CONFIG = {"names": {"controller": "belief"}, "note": "x" * 4000}  # about as long as a real one


def measure(sizes: Sizes, folder: Path) -> dict[str, Any]:
    """For every number of rows a file: bytes a row, ms to write a file, seconds to read a million rows."""
    found = {}
    for count in sizes.rows_per_file:
        files = max(1, min(MILLION // count, sizes.row_files))
        rounds.say(f"rows: {files} files of {count}")
        cell = folder / f"belief-{count:012d}"
        write = sum(_write(cell, at * count, count) for at in range(files))
        began = time.perf_counter()
        read = len(results.read_rows(cell))
        seconds = time.perf_counter() - began
        if read != files * count:
            raise RuntimeError(f"{read} of {files * count} rows were read")
        size = sum(path.stat().st_size for path in cell.iterdir())
        found[count] = {
            "files": files,
            "bytes": size / read,
            "write_ms": 1e3 * write / files,
            "read_s": seconds / read,
        }
    return {str(count): values for count, values in found.items()}


def _write(cell: Path, first: int, count: int) -> float:
    """One file of synthetic rows that compress no better than real ones; the seconds that writing took."""
    noise = np.random.default_rng(first).standard_normal((count, 6)).tolist()
    names = ("cost", "running_cost", "terminal_cost", "clearance", "final_distance", "ess")
    same = {
        "seed": 0,
        "status": "ok",
        "controller": "belief",
        "theta": 1.0,
        "w_obs": 300.0,
        "steps": 60,
        "error": None,
    }
    made = [
        {"trial": first + at, **same, "collided": False, **dict(zip(names, values, strict=True))}
        for at, values in enumerate(noise)
    ]
    began = time.perf_counter()
    results.write_rows(cell, made, {"config": CONFIG})
    return time.perf_counter() - began


def markdown(numbers: dict[str, Any]) -> str:
    """The table."""
    lines = [
        "**Rows on disk**: synthetic rows of random numbers, in part files of so many rows; reading is that of all"
        " files of a cell, checked against their hashes, as `run` does before it goes on and `report` does.",
        "",
        "| rows a file | bytes a row | ms to write a file | s to read a million rows | files of a million rows |",
        "|---|---|---|---|---|",
    ]
    for count, row in numbers.items():
        files = f"{MILLION // int(count):,}".replace(",", " ")
        lines.append(
            f"| {count} | {row['bytes']:.0f} | {row['write_ms']:.1f} | {MILLION * row['read_s']:.1f} | {files} |"
        )
    return "\n".join(lines)
