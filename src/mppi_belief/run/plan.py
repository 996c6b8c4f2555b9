"""Divides a study into chunks: trials of one cell that one worker runs in one go."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Collection
from typing import Any, NamedTuple, Protocol

from ..config.cell import Cell, batches
from ..errors import ConfigError

SMALLEST_CHUNK = 10  # trials
MOST_CHUNKS = 200  # per worker and cell


class Job(Protocol):
    """Describes what a chunk is a part of: a cell of a study, or a named task."""

    @property
    def id(self) -> str: ...
    @property
    def config(self) -> dict[str, Any]: ...


class NamedTask(NamedTuple):
    """Represents a function call that is a job by itself; its only chunk has the trial 0."""

    id: str
    config: dict[str, Any]  # the function's argument


class Chunk(NamedTuple):
    """Represents trials of one job that one worker runs in one go."""

    job: Job
    trials: tuple[int, ...]  # ascending

    @property
    def label(self) -> str:
        """Names the chunk in messages: "belief-0123456789ab trials 3..9", or the name of a task."""
        if isinstance(self.job, NamedTask):
            return self.job.id
        if len(self.trials) == 1:
            return f"{self.job.id} trial {self.trials[0]}"
        return f"{self.job.id} trials {self.trials[0]}..{self.trials[-1]}"

    @property
    def unit(self) -> str:
        """Returns what one of its parts is called in messages."""
        return "task" if isinstance(self.job, NamedTask) else "trial"

    @property
    def batches(self) -> list[tuple[int, ...]]:
        """Returns the trials that are computed together, batch by batch."""
        return list(batches(self.trials, self.job.config.get("batch", 1)))

    def part(self, trials: tuple[int, ...]) -> Chunk:
        """Returns a chunk with some of the trials."""
        return Chunk(self.job, trials)


class Shard(NamedTuple):
    """Represents the i-th of n parts of a study, 1 <= i <= n."""

    i: int
    n: int

    @classmethod
    def parse(cls, text: str) -> Shard:
        """Reads a shard from "i/n"; raises `ConfigError`."""
        match = re.fullmatch(r"([1-9]\d{0,6})/([1-9]\d{0,6})", text)
        if match is None or int(match[1]) > int(match[2]):
            raise ConfigError(
                f"shard={text}: must be i/n with 1 <= i <= n, for instance 3/10: the third of ten "
                "parts; n counts all parts of the study, also when only some are run again"
            )
        return cls(int(match[1]), int(match[2]))

    def has(self, batch: int) -> bool:
        """Returns whether a batch of trials, by its number in the whole study, is in this part:
        every n-th is.
        """
        return batch % self.n == self.i - 1


WHOLE = Shard(1, 1)


def chunks(
    cell: Cell,
    n_trials: int,
    done: Collection[int],
    workers: int,
    shard: Shard = WHOLE,
    position: int = 0,
) -> list[Chunk]:
    """Returns the trials 0..n_trials-1 of a cell that are not done, as chunks of whole batches.

    Chunks are small enough to be shared out and to be lost. `position` is the number of cells
    before this one: it spreads short cells over the shards.
    """
    size = cell.config["batch"]
    trials = [
        trial
        for trial in range(n_trials)
        if trial not in done and shard.has(position + trial // size)
    ]
    missing = list(batches(trials, size))
    share = math.ceil(len(missing) / workers)
    smallest = math.ceil(SMALLEST_CHUNK / size)
    count = max(1, min(share, max(smallest, math.ceil(share / MOST_CHUNKS))))
    return [
        Chunk(cell, tuple(itertools.chain.from_iterable(missing[first : first + count])))
        for first in range(0, len(missing), count)
    ]
