"""Workers on this machine: a process pool of one process for each, so that a death tells which chunk it took along."""

import multiprocessing
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.process import BaseProcess
from typing import Any

from .signals import masked
from .worker import Setup, ready, start_worker

STARTS = 3  # so many workers in a row may die before they have started


class WorkerDied(Exception):
    """A worker ended before its function did."""


class WorkersGone(Exception):
    """There is nobody who could work; the message is one line that says why."""


class Lane:
    """One worker process, started when it is first needed and again when it has died.

    last   what it was given last        busy   whether that is still to be collected
    since  when it was given
    """

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self._executor: ProcessPoolExecutor | None = None
        self._processes: set[BaseProcess] = set()
        self._started: Future[None] | None = None
        self.last: Future[Any] | None = None
        self.busy, self.since = False, 0.0

    def submit(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        # children inherit the mask: a Ctrl-C that reaches them while Python starts must not print a traceback
        with masked():
            try:
                future = self._open().submit(function, *args)
            except BrokenProcessPool:  # it died while it had nothing to do
                self.close(kill=True)
                future = self._reopened(function, *args)
        self.last, self.busy, self.since = future, True, time.monotonic()
        return future

    def _reopened(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        try:
            return self._open().submit(function, *args)
        except BrokenProcessPool as error:
            raise WorkersGone("worker processes die before they are given work") from error

    def _open(self) -> ProcessPoolExecutor:
        if self._executor is None:
            others = {*multiprocessing.active_children()}
            context = multiprocessing.get_context("spawn")
            self._executor = ProcessPoolExecutor(
                1, context, initializer=start_worker, initargs=(self._setup,)
            )
            self._started = self._executor.submit(ready)
            self._processes = {*multiprocessing.active_children()} - others
            # the only other end of the worker's pipe: whoever holds it waits forever for the rest of a result whose
            # worker was killed while it sent it
            results: Any = self._executor._result_queue
            results._writer.close()
        return self._executor

    @property
    def started(self) -> bool:
        """Whether the process has ever answered."""
        return (
            self._started is not None and self._started.done() and self._started.exception() is None
        )

    def kill(self) -> None:
        for process in self._processes:
            process.kill()

    def close(self, *, kill: bool) -> None:
        """End the process: when it has done what it does, or at once."""
        if kill:
            self.kill()  # it ignores the SIGTERM that a broken pool sends
        if self._executor is not None:
            self._executor.shutdown(wait=True, cancel_futures=True)
        self._executor, self._processes, self.busy = None, set(), False


class Lanes:
    """A number of workers on this machine; `elsewhere` where they have another environment than this process."""

    grain = 0.5  # s; starting a chunk and keeping its results takes some milliseconds

    def __init__(self, count: int, setup: Setup | None = None) -> None:
        setup = setup or Setup([], {})
        self.count, self.elsewhere = count, bool(setup.variables)
        self._lanes = [Lane(setup) for _ in range(count)]
        self._stillborn = 0

    def room(self) -> int:
        """How many chunks would begin at once."""
        return sum(not lane.busy for lane in self._lanes)

    def submit(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        """Let an idle worker do something, rather one that runs than a new one."""
        lane = min(
            (lane for lane in self._lanes if not lane.busy), key=lambda lane: not lane.started
        )
        return lane.submit(function, *args)

    def collect(self, future: Future[Any]) -> Any:
        """What came of it; its worker is free again. Raises `WorkerDied`, `WorkersGone`, or what the function did."""
        lane = self._lane(future)
        try:
            result = future.result()
        except BrokenProcessPool as error:
            self._stillborn = 0 if lane.started else self._stillborn + 1
            lane.close(kill=True)
            if self._stillborn >= STARTS:
                raise WorkersGone(
                    f"{STARTS} worker processes in a row died while they started"
                ) from error
            raise WorkerDied("the worker process died") from error
        finally:
            if future.done():
                lane.busy = False
        self._stillborn = 0
        return result

    def discard(self, future: Future[Any]) -> None:
        """End the worker that `future` was given to; it raises `WorkerDied` if it is not done."""
        lane = self._lane(future)
        if lane.busy:
            lane.kill()
        else:
            lane.close(kill=True)

    def withdraw(self, futures: Iterable[Future[Any]]) -> list[Future[Any]]:
        """Take back what no worker has begun: here all begin at once."""
        return []

    def age(self, future: Future[Any]) -> float:
        """Seconds since it began."""
        return time.monotonic() - self._lane(future).since

    def close(self, *, kill: bool = False) -> None:
        """End the workers: when they are idle, or at once."""
        if kill:
            for child in multiprocessing.active_children():
                child.kill()
        for lane in self._lanes:
            lane.close(kill=kill)

    def _lane(self, future: Future[Any]) -> Lane:
        return next(lane for lane in self._lanes if lane.last is future)
