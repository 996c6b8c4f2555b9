"""Watches a run of many cheap trials: the memory of its processes, and how its results come to
disk.

Growth is the most that a process holds at any time after the first trials, less what it held then.
"""

import itertools
import re
import time
from pathlib import Path
from typing import Any, NamedTuple

import rounds

from .processes import CommandError, resident_mb, watched, workers_of
from .sizes import Sizes

WORKERS = 2
EVERY = 0.25  # s
KEPT = 100  # looks that are stored, of many


class Look(NamedTuple):
    """Holds what was observed at one moment."""

    seconds: float  # since the start
    trials: int  # on disk
    parts: int  # part files on disk
    mb: dict[str, float]  # resident memory of each process by its name, MB


def measure(sizes: Sizes, folder: Path) -> dict[str, Any]:
    """Returns the memory of the parent and of each worker, and how the part files appeared."""
    rounds.say(f"long_run: {sizes.long_trials} trials")
    results = folder / "results"
    looks = list[Look]()
    start_time = time.perf_counter()

    def observe(pid: int) -> None:
        trials = [trials_in(path.name) for path in results.glob("*/part-*.parquet")]
        pids = {"parent": pid} | {
            f"worker {k + 1}": worker for k, worker in enumerate(workers_of(pid))
        }
        memory_mb = {
            name: mb for name, number in pids.items() if (mb := resident_mb(number)) is not None
        }
        looks.append(Look(time.perf_counter() - start_time, sum(trials), len(trials), memory_mb))

    args = [
        "run",
        "controller=ce",
        "planner.n_samples=50",
        f"n_trials={sizes.long_trials}",
        f"workers={WORKERS}",
    ]
    command = watched([*args, "results_dir=results"], folder, observe, every=EVERY)
    if not any(sizes.long_settled <= look.trials < sizes.long_trials for look in looks):
        raise CommandError("the run was over before its memory could be watched")
    return {
        "trials": sizes.long_trials,
        "settled": sizes.long_settled,
        "seconds": command.seconds,
        **judged(looks, sizes),
    }


def trials_in(name: str) -> int:
    """Returns how many trials a part file has, from its name: trials of a chunk are consecutive."""
    first, last = map(int, re.findall(r"-(\d+)", name)[:2])
    return last - first + 1


def judged(looks: list[Look], sizes: Sizes) -> dict[str, Any]:
    """Returns memory after the first trials, at the last and the most in between, and times of
    files.

    The parent's table and picture come after the last trial and are `parent_peak_mb`.
    """
    watched_looks = [
        look for look in looks if sizes.long_settled <= look.trials < sizes.long_trials
    ]
    memory = {}
    for name in sorted(watched_looks[0].mb) if watched_looks else []:
        memory_mb = [look.mb[name] for look in watched_looks if name in look.mb]
        memory[name] = {
            "first_mb": memory_mb[0],
            "last_mb": memory_mb[-1],
            "growth_mb": max(memory_mb) - memory_mb[0],
        }
    part_times = [b.seconds for a, b in itertools.pairwise(looks) if b.parts > a.parts]
    return {
        "memory": memory,
        "parent_peak_mb": max(look.mb.get("parent", 0.0) for look in looks),
        "parts": looks[-1].parts,
        "first_part_s": part_times[0] if part_times else None,
        "last_part_s": part_times[-1] if part_times else None,
        "longest_wait_s": max((b - a for a, b in itertools.pairwise(part_times)), default=None),
        "looks": [look._asdict() for look in looks[:: max(1, len(looks) // KEPT)]],
    }


def markdown(numbers: dict[str, Any]) -> str:
    """Returns a table of memory and a sentence on the files."""
    lines = [
        f"**A run of {numbers['trials']} trials** of CE-MPPI with 50 samples, {WORKERS} workers: "
        f"{numbers['seconds']:.0f} s, {numbers['parts']} part files from second "
        f"{numbers['first_part_s']:.1f} to {numbers['last_part_s']:.1f}, at most "
        f"{numbers['longest_wait_s']:.1f} s apart. Resident memory in MB:",
        "",
        f"| | after {numbers['settled']} trials | at the last trials | growth at most |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| {name} | {memory_mb['first_mb']:.0f} | {memory_mb['last_mb']:.0f} "
        f"| {memory_mb['growth_mb']:.1f} |"
        for name, memory_mb in numbers["memory"].items()
    ]
    peak = f"{numbers['parent_peak_mb']:.0f} MB"
    lines += ["", f"The parent's table and picture at the end take it to {peak}."]
    return "\n".join(lines)
