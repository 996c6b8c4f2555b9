"""Decides what becomes of a chunk whose worker died."""

from collections import Counter
from typing import NamedTuple

from .plan import Chunk
from .worker import Failure, not_done_after

STRIKES = 2  # deaths of a worker in one trial alone after which the trial is given up


class Verdict(NamedTuple):
    """Says what becomes of a chunk whose worker died."""

    message: str  # one line for the log
    retry: tuple[Chunk, ...]  # to be run again, before all others
    failure: Failure | None  # of the only trial of the chunk, if that is given up


class CrashJudge:
    """Finds the trial that kills its worker: halves a chunk whose worker died, down to one trial.

    Most trials are innocent and do well the second time. A trial alone is given up as "crashed"
    after `STRIKES` deaths, and as "timeout" when its worker was ended because of the time.
    """

    def __init__(self, seconds: float | None) -> None:
        self._seconds = seconds
        self._strikes: Counter[tuple[str, int]] = Counter()

    def judge(self, chunk: Chunk, ended_for_time: bool) -> Verdict:
        """Returns the verdict; `ended_for_time` says that the pool itself ended the worker."""
        if len(chunk.trials) > 1:
            middle = len(chunk.trials) // 2
            halves = (chunk.part(chunk.trials[:middle]), chunk.part(chunk.trials[middle:]))
            cause = "ended a worker that hangs" if ended_for_time else "a worker died"
            return Verdict(f"{chunk.label}: {cause}; running them again", halves, None)

        accused = (chunk.job.id, chunk.trials[0])
        self._strikes[accused] += 1
        if ended_for_time and self._seconds is not None:
            failure = Failure("timeout", not_done_after(self._seconds))
            return Verdict(f"{chunk.label}: it hangs; given up", (), failure)
        if self._strikes[accused] < STRIKES:
            message = f"{chunk.label}: its worker died; running it again"
            return Verdict(message, (chunk,), None)
        failure = Failure(
            "crashed", f"the worker process died {STRIKES} times in this {chunk.unit}"
        )
        return Verdict(
            f"{chunk.label}: it killed its worker {STRIKES} times; given up", (), failure
        )
