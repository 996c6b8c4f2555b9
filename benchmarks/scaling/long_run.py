"""A run of many cheap trials, watched: what its processes hold in memory, and results that come to disk as it goes.

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
    """What was seen at one moment (s since the start): trials and part files on disk, MB of each process by name."""

    seconds: float
    trials: int
    parts: int
    mb: dict[str, float]


def measure(sizes: Sizes, folder: Path) -> dict[str, Any]:
    """Memory of the parent and each worker, how the part files came."""
    rounds.say(f"long_run: {sizes.long_trials} trials")
    results = folder / "results"
    looks = list[Look]()
    began = time.perf_counter()

    def look(pid: int) -> None:
        trials = [trials_in(path.name) for path in results.glob("*/part-*.parquet")]
        pids = {"parent": pid} | {
            f"worker {k + 1}": worker for k, worker in enumerate(workers_of(pid))
        }
        held = {
            name: mb for name, number in pids.items() if (mb := resident_mb(number)) is not None
        }
        looks.append(Look(time.perf_counter() - began, sum(trials), len(trials), held))

    args = [
        "run",
        "controller=ce",
        "planner.n_samples=50",
        f"n_trials={sizes.long_trials}",
        f"workers={WORKERS}",
    ]
    ended = watched([*args, "results_dir=results"], folder, look, every=EVERY)
    if not any(sizes.long_settled <= one.trials < sizes.long_trials for one in looks):
        raise CommandError("the run was over before its memory could be watched")
    return {
        "trials": sizes.long_trials,
        "settled": sizes.long_settled,
        "seconds": ended.seconds,
        **judged(looks, sizes),
    }


def trials_in(name: str) -> int:
    """How many trials a part file has, from its name: the trials of a chunk follow each other."""
    first, last = map(int, re.findall(r"-(\d+)", name)[:2])
    return last - first + 1


def judged(looks: list[Look], sizes: Sizes) -> dict[str, Any]:
    """Memory after the first trials, at the last and the most in between; when the part files came.

    The parent's table and picture come after the last trial and are `parent_peak_mb`."""
    later = [one for one in looks if sizes.long_settled <= one.trials < sizes.long_trials]
    memory = {}
    for name in sorted(later[0].mb) if later else []:
        held = [one.mb[name] for one in later if name in one.mb]
        memory[name] = {"first_mb": held[0], "last_mb": held[-1], "growth_mb": max(held) - held[0]}
    came = [b.seconds for a, b in itertools.pairwise(looks) if b.parts > a.parts]
    return {
        "memory": memory,
        "parent_peak_mb": max(one.mb.get("parent", 0.0) for one in looks),
        "parts": looks[-1].parts,
        "first_part_s": came[0] if came else None,
        "last_part_s": came[-1] if came else None,
        "longest_wait_s": max((b - a for a, b in itertools.pairwise(came)), default=None),
        "looks": [one._asdict() for one in looks[:: max(1, len(looks) // KEPT)]],
    }


def markdown(numbers: dict[str, Any]) -> str:
    """A table of memory and a sentence on the files."""
    lines = [
        f"**A run of {numbers['trials']} trials** of CE-MPPI with 50 samples, {WORKERS} workers: "
        f"{numbers['seconds']:.0f} s, {numbers['parts']} part files from second {numbers['first_part_s']:.1f} to "
        f"{numbers['last_part_s']:.1f}, at most {numbers['longest_wait_s']:.1f} s apart. Resident memory in MB:",
        "",
        f"| | after {numbers['settled']} trials | at the last trials | growth at most |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| {name} | {held['first_mb']:.0f} | {held['last_mb']:.0f} | {held['growth_mb']:.1f} |"
        for name, held in numbers["memory"].items()
    ]
    return "\n".join(
        [
            *lines,
            "",
            f"The parent's table and picture at the end take it to {numbers['parent_peak_mb']:.0f} MB.",
        ]
    )
