"""A study of several cells as the real command runs it, to be disturbed in every way, and what must be true of it."""

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from cli_helpers import COMMAND, TIMEOUT, started
from mppi_belief.results import table as results
from study_helpers import members, poll

N_TRIALS = 30
# two controllers and two seeds: four cells of trials of some 10 ms
SMALL = ("system=scalar_linear", "planner.n_samples=16", "planner.horizon=4", "problem.steps=400")
STUDY = ("-m", "controller=belief,ce", "seed=0,1", *SMALL, f"n_trials={N_TRIALS}")
STOPPED = {signal.SIGINT: 130, signal.SIGTERM: 143}


class Undisturbed(NamedTuple):
    """The folder of its results, the result hash of every cell, the table that it printed."""

    root: Path
    hashes: dict[str, str]
    table: str


class Ended(NamedTuple):
    """How a command ended, what it printed, how long it took (s)."""

    code: int
    out: str
    err: str
    seconds: float


class Run:
    """`mppi-belief run` of one study in one folder."""

    def __init__(self, folder: Path, *study: str) -> None:
        self.folder, self.study = folder, study or STUDY
        self.root = folder / "outputs" / "results"

    def again(self, *more: str, **how: Any) -> Ended:
        """Run it until it ends; `how` is for Popen."""
        began = time.monotonic()
        done = subprocess.run(
            [COMMAND, "run", *self.study, *more],
            cwd=self.folder,
            capture_output=True,
            text=True,
            timeout=TIMEOUT * 3,
            start_new_session=True,
            check=False,
            **how,
        )
        return Ended(done.returncode, done.stdout, done.stderr, time.monotonic() - began)

    @contextmanager
    def begun(self, *more: str, **how: Any) -> Iterator[subprocess.Popen[str]]:
        """Run it in the background; what it says is `err`."""
        with started(self.folder, "run", *self.study, *more, **how) as process:
            yield process

    @property
    def err(self) -> str:
        """What the command in the background said last."""
        return (self.folder / "stderr.txt").read_text()

    def parts(self) -> set[Path]:
        return set(self.root.glob("*/part-*.parquet"))

    def rows(self) -> dict[str, pd.DataFrame]:
        """The rows of every cell, each file readable."""
        if not self.root.exists():
            return {}
        unreadable: list[str] = []
        rows = {
            cell.name: results.read_rows(cell, unreadable.append)
            for cell in sorted(self.root.iterdir())
        }
        assert unreadable == []
        return rows

    def done(self) -> set[tuple[str, int]]:
        """Cell and number of every trial that has a result."""
        return {(cell, trial) for cell, rows in self.rows().items() for trial in rows["trial"]}

    def hashes(self) -> dict[str, str]:
        return {cell: results.result_hash(rows) for cell, rows in self.rows().items()}

    def left_over(self) -> list[str]:
        """Files that are half done."""
        return [path.name for path in self.root.rglob(".tmp-*")]


def begins(process: subprocess.Popen[str]) -> bool:
    """Whether a command's own code runs, and no longer Python's: from then on signals wait for an answer."""
    if process.poll() is not None:
        return True
    blocked = _status(process.pid).get("SigBlk", "0")
    return bool(int(blocked, 16) >> (signal.SIGINT - 1) & 1)


def _status(pid: int) -> dict[str, str]:
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return {}
    return {name: value.strip() for name, _, value in (line.partition(":") for line in lines)}


def workers_of(pid: int) -> list[int]:
    """The worker processes that a command has started."""
    return [
        child for child in members(pid) if child != pid and b"spawn_main" in _command_line(child)
    ]


def _command_line(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def cpu_seconds(pid: int) -> float:
    """What a process has computed."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def busiest(pids: Iterable[int], seconds: float = 1.0) -> int:
    """The process that computes most from now on."""
    before = {pid: cpu_seconds(pid) for pid in pids}
    time.sleep(seconds)
    return max(before, key=lambda pid: cpu_seconds(pid) - before[pid])


def gone_after(group: int, seconds: float = 1.0) -> list[int]:
    """The processes of a group that still run when so much time has passed."""
    until = time.monotonic() + seconds
    while time.monotonic() < until and members(group):
        time.sleep(0.02)
    return members(group)


def when(condition: Callable[[], Any], process: subprocess.Popen[str]) -> None:
    """Wait for something to happen while a command runs."""
    poll(lambda: condition() or process.poll() is not None, TIMEOUT)
    assert process.poll() is None, "it ended before it could be disturbed"
