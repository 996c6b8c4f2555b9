"""Measures all of Table I: wall time with one worker and with two, compiled before and not.

    efficiency at 2 = t_1 / (2 t_2)

It is computed for the command from start to end, for its trials (from the moment when the plan is
checked to the last trial on disk, so the workers' start is included), and for the machine itself:
one process that steps a controller alone, against two that do so at once.
"""

import math
import os
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import median
from typing import Any

import rounds
from plant import WARM_UP
from workload import workload

from .processes import PYTHON, watched
from .sizes import Sizes

WORKERS = (1, 2)
METHODS = 4
TURNS = 5  # of the machine's own efficiency
ROWS = {
    "whole command, nothing compiled before": ("cold", "command"),
    "whole command": ("warm", "command"),
    "its trials": ("warm", "trials"),
}


def measure(sizes: Sizes, folder: Path) -> dict[str, Any]:
    """Returns the seconds of every run, medians, efficiencies, and the machine's own efficiency."""
    rounds.say("table_1: cold")
    runs = {
        "cold": {n: [_run(sizes, n, folder / f"cold-{n}", folder / f"cache-{n}")] for n in WORKERS}
    }
    runs["warm"] = {n: [] for n in WORKERS}
    for k in range(sizes.table_rounds):
        rounds.say(f"table_1: warm, round {k + 1} of {sizes.table_rounds}")
        for n in WORKERS:
            runs["warm"][n].append(_run(sizes, n, folder / f"warm-{n}-{k}", folder / "cache-1"))
    rows = {label: _row(runs[state], span) for label, (state, span) in ROWS.items()}
    own = machine_efficiency(folder)
    return {
        "trials": METHODS * sizes.table_trials,
        "runs": runs,
        "rows": rows,
        "machine_efficiency": own,
    }


def _run(sizes: Sizes, workers: int, folder: Path, cache: Path) -> dict[str, float]:
    """Returns the seconds of one run into an empty folder.

    They are those of the command, of its trials, and until the first trial is on disk.
    """
    results = folder / "results"
    planned = Appearance(results)  # made when all configurations are checked
    args = [
        "run",
        "experiment=table_1",
        f"n_trials={sizes.table_trials}",
        f"workers={workers}",
        "results_dir=results",
    ]
    ended = watched(args, folder, planned, {"XDG_CACHE_HOME": str(cache)})
    written = [path.stat().st_mtime for path in results.glob("*/part-*.parquet")]
    return {
        "command": ended.seconds,
        "trials": max(written) - planned.seen_at,
        "first": min(written) - planned.seen_at,
    }


class Appearance:
    """Notes when a path first existed, in s since the epoch; it is called again and again."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.seen_at = float("nan")

    def __call__(self, pid: int) -> None:
        if math.isnan(self.seen_at) and self.path.exists():
            self.seen_at = time.time()


def _row(runs: dict[int, list[dict[str, float]]], span: str) -> dict[str, float]:
    """Returns the medians with one and with two workers, and the efficiency."""
    one_worker, two_workers = (median(run[span] for run in runs[n]) for n in WORKERS)
    return {
        "one": one_worker,
        "two": two_workers,
        "efficiency": efficiency(one_worker, two_workers),
    }


def efficiency(one_worker: float, two_workers: float) -> float:
    """Returns the efficiency of two workers from the seconds that one and two take."""
    return one_worker / (2 * two_workers)


def machine_efficiency(folder: Path) -> float | None:
    """Returns the efficiency of two processes that share nothing.

    Returns None on a machine with one CPU.
    """
    cpus = sorted(os.sched_getaffinity(0))[-2:]
    if len(cpus) < 2:
        return None
    rounds.say("table_1: what the machine allows")
    pair = [rounds.start(PYTHON, "ours", "pipf", cpu, folder / f"pipf-{cpu}.txt") for cpu in cpus]
    work = workload()
    try:
        for subject in pair:
            subject.ask("prepare", workload=work, dtype="float32")
            subject.ask("time", calls=1)
        turns = [(_step(pair[:1], work), _step(pair, work)) for _ in range(TURNS)]
    finally:
        rounds.end(pair)
    return median(alone / at_once for alone, at_once in turns)


def _step(some: Sequence[Any], work: dict[str, Any]) -> float:
    """Returns the seconds of a control step, averaged over a trial, of processes that run at once.

    The slowest process counts.
    """
    calls = work["steps"] - WARM_UP
    with ThreadPoolExecutor(len(some)) as threads:
        replies = list(
            threads.map(lambda subject: subject.ask("time", calls=calls)["seconds"], some)
        )
    return max(sum(seconds) / len(seconds) for seconds in replies)


def markdown(numbers: dict[str, Any]) -> str:
    """Returns a table of seconds."""
    own = numbers["machine_efficiency"]
    repeats = len(next(iter(numbers["runs"]["warm"].values())))
    title = f"**Table I**, {numbers['trials']} trials, seconds, the median of {repeats} warm runs."
    if own is not None:
        title += (
            " A process of its own on each of two CPUs, with nothing shared, reaches an efficiency "
            f"of {own:.2f} here."
        )
    lines = [
        title,
        "",
        "| | 1 worker | 2 workers | efficiency at 2 |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| {label} | {row['one']:.1f} | {row['two']:.1f} | {row['efficiency']:.2f} |"
        for label, row in numbers["rows"].items()
    ]
    return "\n".join(lines)
