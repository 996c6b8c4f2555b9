"""What to run: cells, their identity, and the chunks of trials still missing."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Collection
from typing import NamedTuple

from ..config.cell import Cell, batches
from ..errors import ConfigError

SMALLEST_CHUNK = 10


class Chunk(NamedTuple):
    """Trials of one cell that are run by one worker in one go."""

    cell: Cell
    trials: tuple[int, ...]


class Shard(NamedTuple):
    """The i-th of n parts of a study, 1 <= i <= n."""

    i: int
    n: int

    @classmethod
    def parse(cls, text: str) -> Shard:
        """A shard from "i/n"; raises `ConfigError`."""
        found = re.fullmatch(r"([1-9]\d{0,6})/([1-9]\d{0,6})", text)
        if found is None or int(found[1]) > int(found[2]):
            raise ConfigError(
                f"shard={text}: must be i/n with 1 <= i <= n, for instance 3/10: the third of ten parts"
            )
        return cls(int(found[1]), int(found[2]))

    def has(self, batch: int) -> bool:
        """Whether a batch of trials, by its number in the whole study, belongs to this part: every n-th does."""
        return batch % self.n == self.i - 1


WHOLE = Shard(1, 1)


def chunks(
    cell: Cell,
    n_trials: int,
    done: Collection[int],
    workers: int,
    shard: Shard = WHOLE,
    place: int = 0,
) -> list[Chunk]:
    """The trials 0..n_trials-1 that are not done, in pieces small enough to share out and to lose; whole batches.

    `place` counts the cells before this one: it spreads short cells over the shards.
    """
    size = cell.config["batch"]
    trials = [
        trial for trial in range(n_trials) if trial not in done and shard.has(place + trial // size)
    ]
    missing = list(batches(trials, size))
    share = math.ceil(len(missing) / workers)
    count = min(share, max(math.ceil(SMALLEST_CHUNK / size), math.ceil(share / 200)))
    starts = range(0, len(missing), max(count, 1))
    return [
        Chunk(cell, tuple(itertools.chain.from_iterable(missing[at : at + count]))) for at in starts
    ]
