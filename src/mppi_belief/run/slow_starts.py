"""Says in a log what has had no result for some seconds, as while its program is compiled.

On a terminal the progress bar is watched. A log, or a pipe, would stay empty for up to two minutes.
"""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from .log import log_off_terminal

PATIENCE = 5.0  # s without a result, after which a line is written


class SlowStarts:
    """Watches jobs until their first result."""

    def __init__(self) -> None:
        self._start_times: dict[str, float] = {}  # s, by the monotonic clock, by id of a job
        self._done: set[str] = set()  # ids of jobs with a result, or with a line

    def running(self, job_id: str) -> None:
        """Takes note that a part of a job is running; writes its line when it is due."""
        if job_id in self._done:
            return
        now = time.monotonic()
        if now - self._start_times.setdefault(job_id, now) >= PATIENCE:
            self._done.add(job_id)
            log_off_terminal(f"{job_id}: compiling or computing its first result")

    def ended(self, job_id: str) -> None:
        """Takes note that a part of a job has ended."""
        self._done.add(job_id)


@contextmanager
def announced(line: str) -> Iterator[None]:
    """Writes a line, once, if the block takes longer than `PATIENCE`."""
    timer = threading.Timer(PATIENCE, log_off_terminal, [line])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
