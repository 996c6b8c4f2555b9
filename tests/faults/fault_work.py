"""Fake work that is hard to bring back: larger than a pipe, or an exception without a way home.

Workers import this.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mppi_belief.config.cell import Cell
from mppi_belief.run.local import LocalWorkers
from mppi_belief.run.plan import Chunk
from mppi_belief.run.pool import Pool
from mppi_belief.run.worker import WorkerSetup
from study_helpers import TESTS, config, poll

HERE = str(Path(__file__).parent)


def bulky(config: dict[str, Any], trials: Sequence[int]) -> list[bytes]:
    """A result of 4 MB; says the first time that it begins, and waits for an answer."""
    folder = Path(config["system"]["folder"])
    if not any(folder.iterdir()):
        (folder / str(os.getpid())).touch()
        poll((folder / "go").exists)
    return [bytes(1 << 22)]


def send_bulky_results(folder: str) -> None:
    """A parent, to be run in a process of its own."""
    pool = Pool(
        bulky,
        LocalWorkers(1, WorkerSetup([TESTS, HERE], {})),
        lambda line: print(line.partition(": ")[2], flush=True),
    )
    chunks = [Chunk(Cell(config(folder=folder)), (trial,)) for trial in range(3)]
    done = [*pool.run(chunks)]
    pool.close()
    print(sum(len(first.outcome) for first in done), "results")


class Unpicklable(Exception):
    """It pickles, but cannot be made again from its one argument."""

    def __init__(self, first: str, second: str) -> None:
        super().__init__(f"{first} {second}")


def unpicklable(config: dict[str, Any], trials: Sequence[int]) -> list[int]:
    """Trial 1 has no luck."""
    if 1 in trials:
        raise Unpicklable("two", "words")
    return list(trials)
