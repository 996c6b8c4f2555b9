"""Ends workers that are so late that they cannot even look at the clock themselves."""

from concurrent.futures import Future
from typing import Any

from .workers import Workers

# s beyond the time that a function may take, before its worker is ended from outside.
PATIENCE = 30.0


class Watchdog:
    """Watches the age of running functions; each batch of trials in them may take `seconds` (None:
    any time).
    """

    def __init__(self, workers: Workers, seconds: float | None) -> None:
        self._workers = workers
        self._seconds = seconds
        self._ended: set[Future[Any]] = set()

    def check(self, future: Future[Any], batches: int = 1) -> None:
        """Ends the worker of a function that is overdue."""
        if self._seconds is None or future in self._ended:
            return
        if self._workers.age(future) > self._seconds * batches + PATIENCE:
            self._ended.add(future)
            self._workers.discard(future)

    def release(self, future: Future[Any]) -> bool:
        """Returns whether the worker of a function was ended, and forgets the function."""
        ended = future in self._ended
        self._ended.discard(future)
        return ended
