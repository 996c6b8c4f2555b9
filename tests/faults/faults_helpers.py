"""A study of several cells as the real command runs it, to be disturbed in every way, and what must
be true of it.
"""

import itertools
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from cli_helpers import COMMAND, TIMEOUT, started, without_slow_starts
from gate_helpers import EVERYTHING, GATED, Gate
from mppi_belief.results import table as results
from mppi_belief.results.contents import read_rows
from study_helpers import members, poll

N_TRIALS = 30
# two controllers and two seeds: four cells of trials of some 10 ms
SMALL = ("system=scalar_linear", "planner.n_samples=16", "planner.horizon=4", "problem.steps=400")
CONTROLLERS = ("--config-dir", GATED, "controller=gated_belief,gated_ce")
STUDY = ("-m", *CONTROLLERS, "seed=0,1", *SMALL, f"n_trials={N_TRIALS}")
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
        self.folder = folder
        self.study = study or STUDY
        self.root = folder / "outputs" / "results"
        self._gates = itertools.count(1)

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
        err = without_slow_starts(done.stderr)
        return Ended(done.returncode, done.stdout, err, time.monotonic() - began)

    def gate(self, admitted: int = EVERYTHING) -> Gate:
        """Returns a new gate, which admits so many trials of a command that is begun with it."""
        return Gate(self.folder / "gates" / str(next(self._gates)), admitted)

    @contextmanager
    def begun(
        self, *more: str, gate: Gate | None = None, **how: Any
    ) -> Iterator[subprocess.Popen[str]]:
        """Run it in the background, its trials behind a gate if there is one; what it says is
        `err`.
        """
        environment = gate.environment if gate else None
        with started(self.folder, "run", *self.study, *more, env=environment, **how) as process:
            yield process

    @property
    def err(self) -> str:
        """Returns what the command in the background wrote to stderr."""
        return without_slow_starts((self.folder / "stderr.txt").read_text())

    def parts(self) -> set[Path]:
        return set(self.root.glob("*/part-*.parquet"))

    def rows(self) -> dict[str, pd.DataFrame]:
        """The rows of every cell, each file readable."""
        if not self.root.exists():
            return {}
        unreadable: list[str] = []
        rows = {
            cell.name: read_rows(cell, unreadable.append) for cell in sorted(self.root.iterdir())
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
    """Returns whether a command's own code runs, and no longer Python's.

    From then on signals wait for an answer.
    """
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


def kill_one_that_waits(gate: Gate, process: subprocess.Popen[str]) -> None:
    """Kill a worker that waits at the gate, so that it has a trial."""
    when(gate.waiting, process)
    os.kill(gate.waiting()[0], signal.SIGKILL)


def send(
    run: Run, process: subprocess.Popen[str], *numbers: signal.Signals, group: bool = True
) -> None:
    """Send signals to a command, to all of its processes as a terminal does, or to the leading one.

    The second one is sent when the command has answered the first.
    """
    for position, number in enumerate(numbers):
        if position > 0:
            when(lambda: "stopping" in run.err, process)
        (os.killpg if group else os.kill)(process.pid, number)
    if len(numbers) == 1:
        poll(lambda: "stopping" in run.err or process.poll() is not None, TIMEOUT)
