"""Runs chunks of trials, or named tasks, in workers, so that every trial gets a result.

The pool promises:

1. Every trial is yielded once, with what its worker made of it or with a `Failure`. An exception in
   a batch of trials fails that batch and no other.
2. When a worker dies, its chunk is run again in halves, until the trial that kills its worker is
   found; a trial whose worker dies twice is given up as "crashed" (`crashes.py`).
3. A batch that takes longer than `seconds` is given up as "timeout". Its worker is ended, and the
   batches that it had not begun are run again. The worker itself looks at the clock; one that
   hangs so that it cannot is ended from outside (`watchdog.py`).
4. A mistake of the user or of the machine (`ConfigError`) is no trial's fault and ends the run, and
   so does the loss of all workers (`WorkersGone`); what has come back before is yielded.
5. After `stop()` no chunk is started, and those that run are finished.

Which chunk comes next is decided in `chunk_queue.py`. docs/reliability.md says which test holds
each promise.
"""

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from types import TracebackType
from typing import Any, NamedTuple

from ..errors import ConfigError
from .chunk_queue import ChunkQueue
from .crashes import STRIKES, CrashJudge
from .plan import Chunk, Job
from .signals import StoppedAtOnce
from .slow_starts import SlowStarts
from .watchdog import Watchdog
from .worker import ChunkReport, Failure, TimeLimitExceeded, call_within, not_done_after, run_chunk
from .workers import WorkerDied, Workers, WorkersGone

TICK = 0.25  # s between two looks at stop requests, clocks and results that wait to be written


class CompletedBatch(NamedTuple):
    """Holds trials of a job that have ended."""

    job: Job
    trials: tuple[int, ...]
    outcome: Any  # what the work returned for these trials, or `Failure`
    machine: dict[str, Any]  # of the worker, see `results.provenance.machine`; {} if it died


class Pool:
    """Runs `work(config, trials)` on chunks; a batch of trials may take `seconds` (None: any time).

    `log` is called with one line for each event. As a context manager the pool ends its workers:
    when they are idle, or at once where the block raises.
    """

    def __init__(
        self,
        work: Callable[..., Any],
        workers: Workers,
        log: Callable[[str], None],
        seconds: float | None = None,
    ) -> None:
        self._work = work
        self._workers = workers
        self._log = log
        self._seconds = seconds
        self._queue = ChunkQueue(workers.grain, workers.count)
        self._crashes = CrashJudge(seconds)
        self._watchdog = Watchdog(workers, seconds)
        self._slow_starts = SlowStarts()
        self._running: dict[Future[Any], Chunk] = {}
        self._stopping = threading.Event()

    def __enter__(self) -> "Pool":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            self.close(kill=kind is not None)
        except BaseException:  # a second signal, while the workers become idle
            self.close(kill=True)
            raise

    def stop(self) -> None:
        """Starts no more chunks; those that run are finished."""
        self._stopping.set()

    def close(self, *, kill: bool = False) -> None:
        """Ends the workers: when they are idle, or at once."""
        self._workers.close(kill=kill)

    def run(
        self, chunks: Iterable[Chunk], tick: Callable[[], object] = lambda: None
    ) -> Iterator[CompletedBatch]:
        """Yields every batch of trials as it ends, and calls `tick` several times per second.

        Raises `ConfigError` where the work does, and `WorkersGone` if no worker is left.
        """
        for chunk in chunks:
            self._queue.add(chunk)
        while self._running or (self._queue and not self._stopping.is_set()):
            # Start as many chunks as there are idle workers, and wait until one ends.
            if self._stopping.is_set():
                for future in self._workers.withdraw([*self._running]):
                    del self._running[future]
            self._start_chunks()
            ended = wait(self._running, timeout=TICK, return_when=FIRST_COMPLETED).done

            # Collect results; workers get their next chunk before the results are written.
            completed, error = self._collect_all(ended)
            if error is None:
                self._start_chunks()
            yield from completed
            if error is not None:
                raise error

            for future, chunk in self._running.items():
                self._watchdog.check(future, len(chunk.batches))
                self._slow_starts.running(chunk.job.id)
            tick()

    def call(self, function: Callable[..., Any], *args: Any) -> Any:
        """Returns `function(*args)` from a worker; calls it a second time where the worker died.

        Raises what the function raises, `WorkerDied`, `TimeLimitExceeded` if it takes as long as a
        batch of trials may, or `StoppedAtOnce` if it has not begun when all is to stop.
        """
        for _ in range(STRIKES - 1):
            try:
                return self._call_once(function, *args)
            except WorkerDied:
                self._raise_if_stopping()
        return self._call_once(function, *args)

    def _call_once(self, function: Callable[..., Any], *args: Any) -> Any:
        while self._workers.room() <= 0:
            self._raise_if_stopping()
            time.sleep(TICK)
        future = self._workers.submit(call_within, self._seconds, function, *args)
        while not wait([future], timeout=TICK).done:
            if self._stopping.is_set() and self._workers.withdraw([future]):
                self._raise_if_stopping()
            self._watchdog.check(future)
        ended_for_time = self._watchdog.release(future)
        try:
            return self._workers.collect(future)
        except WorkerDied as error:
            if ended_for_time and self._seconds is not None:
                raise TimeLimitExceeded(not_done_after(self._seconds)) from error
            raise
        except TimeLimitExceeded:
            self._workers.discard(future)
            raise

    def _raise_if_stopping(self) -> None:
        if self._stopping.is_set():
            raise StoppedAtOnce

    def _start_chunks(self) -> None:
        while self._queue and not self._stopping.is_set() and self._workers.room() > 0:
            chunk = self._queue.next()
            future = self._workers.submit(
                run_chunk, self._work, chunk.job.config, chunk.batches, self._seconds
            )
            self._running[future] = chunk

    def _collect_all(
        self, ended: Iterable[Future[Any]]
    ) -> tuple[list[CompletedBatch], Exception | None]:
        """Returns the batches of ended chunks, and the error that ends the run, or None."""
        completed: list[CompletedBatch] = []
        run_error: Exception | None = None
        for future in ended:
            try:
                completed.extend(self._collect(future))
            except (ConfigError, WorkersGone) as error:
                run_error = error
        return completed, run_error

    def _collect(self, future: Future[Any]) -> Iterator[CompletedBatch]:
        """Yields the batches of a chunk that has ended.

        Trials without a result are queued again.
        """
        chunk = self._running.pop(future)
        self._slow_starts.ended(chunk.job.id)
        ended_for_time = self._watchdog.release(future)
        try:
            report: ChunkReport = self._workers.collect(future)
        except WorkerDied:
            yield from self._after_crash(chunk, ended_for_time)
            return
        except (ConfigError, WorkersGone):
            raise
        except Exception as error:
            yield CompletedBatch(*chunk, Failure("error", f"{type(error).__name__}: {error}"), {})
            return

        n_trials = sum(len(trials) for trials, _ in report.outcomes)
        self._queue.set_pace(chunk.job.id, report.seconds / max(n_trials, 1))
        for trials, outcome in report.outcomes:
            yield CompletedBatch(chunk.job, trials, outcome, report.machine)
            if isinstance(outcome, Failure) and outcome.status == "timeout":
                self._log(f"{chunk.part(trials).label}: {outcome.error}; given up")
                self._workers.discard(future)
        if report.unfinished:
            self._queue.repeat(chunk.part(report.unfinished))
        if report.mistake is not None:
            raise ConfigError(report.mistake)

    def _after_crash(self, chunk: Chunk, ended_for_time: bool) -> Iterator[CompletedBatch]:
        """Puts a chunk whose worker died back into the queue, or yields its only trial with its
        failure.
        """
        verdict = self._crashes.judge(chunk, ended_for_time)
        self._log(verdict.message)
        self._queue.repeat_next(*verdict.retry)
        if verdict.failure is not None:
            yield CompletedBatch(*chunk, verdict.failure, {})
