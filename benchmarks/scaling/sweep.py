"""Measures what a cell of a sweep costs, by the times of the files of a small and of a large sweep.

The compilation cache is the sweep's own: a program that the large sweep needs and the small one
does not is a new file in it.
"""

import itertools
from pathlib import Path
from statistics import median
from typing import Any

import rounds

from .processes import Ended, programs, run
from .sizes import Sizes

TRIALS = 2  # of each cell
FILES = ("part-*.parquet", "timing.json")
PHASES = ("until the first trials are on disk", "trials", "the Time column", "table and pictures")


def measure(sizes: Sizes, folder: Path) -> dict[str, Any]:
    """Returns the ms per cell in each phase and the programs compiled for few and many cells."""
    cache = folder / "cache"
    (few, many) = sizes.sweep_cells
    rounds.say(f"sweep: {few} cells")
    _run(few, folder / "cold", cache)
    compiled_programs = [programs(cache)]
    times: dict[int, list[dict[str, float]]] = {few: [], many: []}
    for k in range(sizes.sweep_rounds):
        rounds.say(f"sweep: {few} cells and {many}, round {k + 1} of {sizes.sweep_rounds}")
        for cells in times:
            times[cells].append(_run(cells, folder / f"warm-{cells}-{k}", cache))
    compiled_programs.append(programs(cache))
    return {
        "cells": sizes.sweep_cells,
        "trials": TRIALS,
        "seconds": times,
        "ms_per_cell": {phase: _slope(times, phase) for phase in times[few][0]},
        "programs": dict(zip(("few", "many"), compiled_programs, strict=True)),
    }


def _slope(times: dict[int, list[dict[str, float]]], phase: str) -> float:
    """Returns the ms that one more cell adds to a phase, from the medians of the rounds."""
    (few, a), (many, b) = (
        (cells, median(phases_of_run[phase] for phases_of_run in runs))
        for cells, runs in times.items()
    )
    return 1e3 * (b - a) / (many - few)


def _run(cells: int, folder: Path, cache: Path) -> dict[str, float]:
    """Returns the seconds of each phase, and of all, of a sweep over theta and w_obs."""
    args = [
        "run",
        "-m",
        "controller=belief",
        "planner.n_samples=50",
        f"n_trials={TRIALS}",
        "workers=2",
    ]
    args += [
        "results_dir=results",
        f"theta={','.join(f'{0.1 * k:g}' for k in range(cells // 2))}",
        "w_obs=100,200",
    ]
    return phases(run(args, folder, {"XDG_CACHE_HOME": str(cache)}), folder / "results")


def phases(ended: Ended, results: Path) -> dict[str, float]:
    """Returns the seconds from one kind of file to the next."""
    parts, timings = (
        sorted(path.stat().st_mtime for path in results.glob(f"*/{kind}")) for kind in FILES
    )
    moments = [ended.started, parts[0], parts[-1], timings[-1], ended.started + ended.seconds]
    lengths = [b - a for a, b in itertools.pairwise(moments)]
    return dict(zip(PHASES, lengths, strict=True)) | {"all": ended.seconds}


def markdown(numbers: dict[str, Any]) -> str:
    """Returns a table of milliseconds and the number of compiled programs."""
    few, many = numbers["cells"]
    same = numbers["programs"]["few"] == numbers["programs"]["many"]
    lines = [
        f"**A cell of a sweep** over theta and w_obs, {numbers['trials']} trials each, 50 samples, "
        f"2 workers: ms per cell, from {few} cells and {many}. The programs compiled for {few} "
        f"cells, {numbers['programs']['few']}, are "
        + (
            "all that the others need."
            if same
            else f"not all: {many} cells needed {numbers['programs']['many']}."
        ),
        "",
        "| | ms |",
        "|---|---|",
    ]
    return "\n".join(
        [*lines, *(f"| {phase} | {ms:.0f} |" for phase, ms in numbers["ms_per_cell"].items())]
    )
