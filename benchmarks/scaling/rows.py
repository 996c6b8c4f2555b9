"""Measures rows on disk: their size, and the time to write them and to read a million of them."""

import time
from pathlib import Path
from typing import Any

import numpy as np

import rounds
from mppi_belief.results import table as results
from mppi_belief.results.contents import read_rows

from .sizes import Sizes

MILLION = 1_000_000
CONFIG = {"names": {"controller": "belief"}, "note": "x" * 4000}  # about as long as a real one


def measure(sizes: Sizes, folder: Path) -> dict[str, Any]:
    """Returns for every number of rows per file: bytes per row, ms to write a file, s to read a
    row.
    """
    numbers = {}
    for count in sizes.rows_per_file:
        files = max(1, min(MILLION // count, sizes.row_files))
        rounds.say(f"rows: {files} files of {count}")
        cell = folder / f"belief-{count:012d}"
        write = sum(_write(cell, index * count, count) for index in range(files))
        start_time = time.perf_counter()
        read = len(read_rows(cell))
        seconds = time.perf_counter() - start_time
        if read != files * count:
            raise RuntimeError(f"{read} of {files * count} rows were read")
        size = sum(path.stat().st_size for path in cell.iterdir())
        numbers[count] = {
            "files": files,
            "bytes": size / read,
            "write_ms": 1e3 * write / files,
            "read_s": seconds / read,
        }
    return {str(count): values for count, values in numbers.items()}


def _write(cell: Path, first: int, count: int) -> float:
    """Writes one file of synthetic rows and returns the seconds that this took.

    The rows compress no better than real ones.
    """
    noise = np.random.default_rng(first).standard_normal((count, 6)).tolist()
    names = ("cost", "running_cost", "terminal_cost", "clearance", "final_distance", "ess")
    shared_values = {
        "seed": 0,
        "status": "ok",
        "controller": "belief",
        "theta": 1.0,
        "w_obs": 300.0,
        "steps": 60,
        "error": None,
    }
    rows = [
        {
            "trial": first + index,
            **shared_values,
            "collided": False,
            **dict(zip(names, values, strict=True)),
        }
        for index, values in enumerate(noise)
    ]
    start_time = time.perf_counter()
    results.write_rows(cell, rows, {"config": CONFIG})
    return time.perf_counter() - start_time


def markdown(numbers: dict[str, Any]) -> str:
    """Returns the table."""
    lines = [
        "**Rows on disk**: synthetic rows of random numbers, in part files of so many rows. "
        "Reading is that of all files of a cell, checked against their hashes, as in `report`.",
        "",
        "| rows per file | bytes per row | ms to write a file | s to read a million rows "
        "| files of a million rows |",
        "|---|---|---|---|---|",
    ]
    for count, row in numbers.items():
        files = f"{MILLION // int(count):,}".replace(",", " ")
        lines.append(
            f"| {count} | {row['bytes']:.0f} | {row['write_ms']:.1f} "
            f"| {MILLION * row['read_s']:.1f} | {files} |"
        )
    return "\n".join(lines)
