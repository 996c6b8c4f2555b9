"""Measures how long short commands take: help, a tiny run, a run that finds everything done."""

from pathlib import Path
from statistics import median
from typing import Any

import rounds

from .processes import run
from .sizes import Sizes

TINY = ("run", "controller=belief", "n_trials=2", "workers=1")


def measure(sizes: Sizes, folder: Path) -> dict[str, Any]:
    """Returns the seconds of each command and their medians.

    Repeats are interleaved, and everything is compiled before.
    """
    rounds.say(f"start_up: {sizes.starts} of each")
    cache = {"XDG_CACHE_HOME": str(folder / "cache")}
    run([*TINY, "results_dir=done"], folder, cache)
    seconds: dict[str, list[float]] = {}
    for k in range(sizes.starts):
        commands = {
            "--help": ["--help"],
            "run --help": ["run", "--help"],
            "run, 2 trials": [*TINY, f"results_dir=fresh-{k}"],
            "run, all done": [*TINY, "results_dir=done"],
        }
        for label, args in commands.items():
            seconds.setdefault(label, []).append(run(args, folder, cache).seconds)
    return {
        "seconds": seconds,
        "median": {label: median(times) for label, times in seconds.items()},
    }


def markdown(numbers: dict[str, Any]) -> str:
    """Returns a table of seconds."""
    repeats = len(next(iter(numbers["seconds"].values())))
    lines = [
        f"**Start-up**, seconds, the median of {repeats}:",
        "",
        "| `mppi-belief ...` | s |",
        "|---|---|",
    ]
    return "\n".join(
        [*lines, *(f"| {label} | {s:.2f} |" for label, s in numbers["median"].items())]
    )
