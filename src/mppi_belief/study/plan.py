"""What to run: cells, their identity, and the chunks of trials still missing."""

import hashlib
import itertools
import json
import math
from collections.abc import Collection, Iterator
from typing import Any, NamedTuple

from ..settings import batches

ALGORITHM_VERSION = 2  # raise when the same configuration would give other numbers
IDENTITY = ("system", "cost", "problem", "filter", "controller", "names", "seed", "precision", "platform", "batch")
SMALLEST_CHUNK = 10


class Cell(NamedTuple):
    """One setting of everything, to be run for many trials; see `mppi_belief.experiment` for the config."""

    config: dict[str, Any]

    @property
    def id(self) -> str:
        """Controller and hash: what makes two cells the same, whoever runs them, with how many trials or workers."""
        identity = {key: self.config[key] for key in IDENTITY} | {"algorithm": ALGORITHM_VERSION}
        text = json.dumps(identity, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return f"{self.config['names']['controller']}-{hashlib.sha256(text.encode()).hexdigest()[:12]}"


class Chunk(NamedTuple):
    """Trials of one cell that are run by one worker in one go."""

    cell: Cell
    trials: tuple[int, ...]


def chunks(cell: Cell, n_trials: int, done: Collection[int], workers: int) -> Iterator[Chunk]:
    """The trials 0..n_trials-1 that are not done, in pieces small enough to share out and to lose; whole batches."""
    size = cell.config["batch"]
    missing = list(batches([trial for trial in range(n_trials) if trial not in done], size))
    share = math.ceil(len(missing) / workers)
    count = min(share, max(math.ceil(SMALLEST_CHUNK / size), math.ceil(share / 200)))
    for start in range(0, len(missing), max(count, 1)):
        yield Chunk(cell, tuple(itertools.chain.from_iterable(missing[start : start + count])))
