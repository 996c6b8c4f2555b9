"""A study on a real Slurm, by the real command, and its jobs."""

import subprocess
import time
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from cli_helpers import COMMAND, without_slow_starts
from mppi_belief.results.contents import read_rows
from study_helpers import poll

MINE = str(Path(__file__).parent / "mine")
STUDY = (
    "run",
    "--config-dir",
    MINE,
    "system=scalar_linear",
    "controller=patient",
    "problem.steps=3",
    "planner.horizon=2",
)
SLURM = ("executor=slurm", "executor.memory=1GB", "executor.walltime=00:10:00")
TRIALS = 200  # of a tenth of a second each


class Ended(NamedTuple):
    """How a command ended, what it said, how long it took (s)."""

    code: int
    err: str
    seconds: float


def run(folder: Path, *args: str, n_trials: int = TRIALS) -> Ended:
    """A study in a folder, until it ends."""
    began = time.monotonic()
    command = [COMMAND, *STUDY, f"n_trials={n_trials}", "results_dir=results", *args]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=300, check=False
    )
    return Ended(done.returncode, without_slow_starts(done.stderr), time.monotonic() - began)


def rows(folder: Path) -> pd.DataFrame:
    """The rows of the only cell."""
    (cell,) = (folder / "results").iterdir()
    return read_rows(cell)


def parts(folder: Path) -> list[Path]:
    return sorted((folder / "results").glob("*/part-*.parquet"))


def jobs(*states: str) -> list[str]:
    """The jobs that are in one of the states, or in any but completing."""
    answer = subprocess.run(
        ["squeue", "-h", "-o", "%A %t"], capture_output=True, text=True, timeout=30, check=True
    )
    fields = [line.split() for line in answer.stdout.splitlines()]
    return [job for job, state in fields if state in states or (not states and state != "CG")]


def no_jobs(seconds: float = 10) -> float:
    """Wait until there are none; how long that took (s)."""
    began = time.monotonic()
    poll(lambda: not jobs(), seconds)
    return time.monotonic() - began
