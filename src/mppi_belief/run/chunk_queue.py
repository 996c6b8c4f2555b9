"""Holds the chunks that are still to be run, and joins short ones until they are worth sending."""

import math
from collections import Counter, deque

from .plan import Chunk


class ChunkQueue:
    """Hands out chunks in order, those that must run again first.

    Chunks of a job whose trials are short are run together, so that a piece takes about `grain`
    seconds. A piece is never more than half of a worker's share of what is left of its job, so that
    all `workers` end at about the same time.
    """

    def __init__(self, grain: float, workers: int) -> None:
        self._grain = grain
        self._workers = workers
        self._first_runs = deque[Chunk]()
        self._repeats = deque[Chunk]()
        self._trials_left: Counter[str] = Counter()  # trials that have not been handed out, by job
        self._pace: dict[str, float] = {}  # s per trial, by job

    def __len__(self) -> int:
        return len(self._first_runs) + len(self._repeats)

    def add(self, chunk: Chunk) -> None:
        """Adds a chunk behind all others."""
        self._first_runs.append(chunk)
        self._trials_left[chunk.job.id] += len(chunk.trials)

    def repeat_next(self, *chunks: Chunk) -> None:
        """Puts chunks that must run again before all others."""
        self._repeats.extendleft(reversed(chunks))

    def repeat(self, chunk: Chunk) -> None:
        """Puts a chunk that must run again behind the others that must."""
        self._repeats.append(chunk)

    def set_pace(self, job_id: str, seconds: float) -> None:
        """Notes the seconds (s) that a trial of a job took; the shortest counts, since the first
        trial compiles.
        """
        self._pace[job_id] = min(seconds, self._pace.get(job_id, math.inf))

    def next(self) -> Chunk:
        """Removes and returns the next piece of work."""
        if self._repeats:
            return self._repeats.popleft()
        chunk = self._first_runs.popleft()
        job = chunk.job
        pace = max(self._pace.get(job.id, math.inf), 1e-9)
        most = min(self._grain / pace, self._trials_left[job.id] / (2 * self._workers))
        trials = list(chunk.trials)
        while self._first_runs and self._first_runs[0].job is job:
            if len(trials) + len(self._first_runs[0].trials) > most:
                break
            trials += self._first_runs.popleft().trials
        self._trials_left[job.id] -= len(trials)
        return chunk.part(tuple(trials))
