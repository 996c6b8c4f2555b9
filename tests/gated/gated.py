"""Controllers of the package behind a gate: a worker waits here until the test lets its trial
begin.

A configuration names `gated.MPPI` instead of `mppi_belief.MPPI`. `run_trials` looks the class up
for every batch of trials, and each look-up in a worker takes a ticket of the gate
(`gate_helpers.Gate`). Without a gate, and in the leading process, nothing waits; the class, and
with it every number, is the package's own.
"""

import fcntl
import multiprocessing
import os
import time
from pathlib import Path
from typing import Any

import mppi_belief as mb

VARIABLE = "MPPI_BELIEF_TEST_GATE"  # the folder of the gate
PAUSE = 0.01  # s between two looks at the gate


def take_ticket(folder: Path) -> int:
    """Returns the number of lookups before this one, over all processes, and notes the process that
    asks.
    """
    with (folder / "tickets").open("a+") as tickets:
        fcntl.flock(tickets, fcntl.LOCK_EX)
        tickets.seek(0)
        number = len(tickets.readlines())
        tickets.write(f"{os.getpid()}\n")
    return number


def wait_for_gate() -> None:
    """Waits until the gate admits this ticket."""
    folder = os.environ.get(VARIABLE)
    if folder is None or multiprocessing.parent_process() is None:
        return
    number = take_ticket(Path(folder))
    while number >= int((Path(folder) / "admitted").read_text()):
        time.sleep(PAUSE)


def __getattr__(name: str) -> Any:
    if name.startswith("_"):  # the import system asks for some of these
        raise AttributeError(name)
    wait_for_gate()
    return getattr(mb, name)
