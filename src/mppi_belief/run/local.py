"""Workers on this machine: a process pool of one process for each, so that a death tells which
chunk it took along.

The library pebble (5.2.3) was tried instead and breaks the promise on a worker that is killed
halfway through sending a result. With one and with two workers, after the death of a worker that
was sending 4 MB to a stopped parent, none of three further tasks had returned when each had been
waited for 20 s.
"""

import multiprocessing
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.process import BaseProcess
from typing import Any

from .signals import masked
from .worker import WorkerSetup, confirm_start, start_worker
from .workers import WorkerDied, WorkersGone

FAILED_STARTS = 3  # so many workers in a row may die before they have started


class WorkerProcess:
    """Runs one worker process, started when it is first needed and again when it has died."""

    def __init__(self, setup: WorkerSetup) -> None:
        self._setup = setup
        self._executor: ProcessPoolExecutor | None = None
        self._processes: set[BaseProcess] = set()
        self._start_confirmed: Future[None] | None = None
        self.latest: Future[Any] | None = None  # the function that it was given last
        self.busy = False  # whether the result of that is still to be collected
        self.submit_time = 0.0  # s, when it was given, by the monotonic clock

    @property
    def started(self) -> bool:
        """Returns whether the process has ever answered."""
        future = self._start_confirmed
        return future is not None and future.done() and future.exception() is None

    @property
    def process_ids(self) -> list[int]:
        """Returns the id of the running process; [] if there is none."""
        return [process.pid for process in self._processes if process.pid and process.is_alive()]

    def submit(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        """Lets the process call a function; raises `WorkersGone` if it dies again and again."""
        # Children inherit the mask: a Ctrl-C that reaches them while Python starts must not print a
        # traceback.
        with masked():
            try:
                future = self._open().submit(function, *args)
            except BrokenProcessPool:  # it died while it had nothing to do
                self.close(kill=True)
                future = self._submit_to_new_process(function, *args)
        self.latest = future
        self.busy = True
        self.submit_time = time.monotonic()
        return future

    def _submit_to_new_process(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        try:
            return self._open().submit(function, *args)
        except BrokenProcessPool as error:
            raise WorkersGone("worker processes die before they are given work") from error

    def _open(self) -> ProcessPoolExecutor:
        """Returns the executor, with its process running."""
        if self._executor is None:
            children_before = {*multiprocessing.active_children()}
            context = multiprocessing.get_context("spawn")
            self._executor = ProcessPoolExecutor(
                1, context, initializer=start_worker, initargs=(self._setup,)
            )
            self._start_confirmed = self._executor.submit(confirm_start)
            self._processes = {*multiprocessing.active_children()} - children_before
            # The only other end of the worker's pipe: whoever holds it waits forever for the rest
            # of a result whose worker was killed while it sent it.
            results: Any = self._executor._result_queue
            results._writer.close()
        return self._executor

    def kill(self) -> None:
        """Ends the process at once."""
        for process in self._processes:
            process.kill()

    def close(self, *, kill: bool) -> None:
        """Ends the process: when its function has ended, or at once."""
        if kill:
            self.kill()  # it ignores the SIGTERM that a broken pool sends
        if self._executor is not None:
            self._executor.shutdown(wait=True, cancel_futures=True)
        self._executor = None
        self._processes = set()
        self.busy = False


class LocalWorkers:
    """Runs a number of workers on this machine; see `Workers` for what its methods do."""

    grain = 0.5  # s; starting a chunk and writing its results takes some milliseconds

    def __init__(self, count: int, setup: WorkerSetup | None = None) -> None:
        setup = setup or WorkerSetup([], {})
        self.count = count
        self.own_environment = bool(setup.variables)
        self._processes = [WorkerProcess(setup) for _ in range(count)]
        self._failed_starts = 0

    @property
    def process_ids(self) -> list[int]:
        """Returns the ids of the worker processes that run."""
        return [pid for process in self._processes for pid in process.process_ids]

    def room(self) -> int:
        """Returns the number of idle workers."""
        return sum(not process.busy for process in self._processes)

    def submit(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        """Lets an idle worker call a function, rather one that runs than a new one."""
        idle = [process for process in self._processes if not process.busy]
        return min(idle, key=lambda process: not process.started).submit(function, *args)

    def collect(self, future: Future[Any]) -> Any:
        """Returns or raises what the function did; raises `WorkerDied` or `WorkersGone`."""
        process = self._process_of(future)
        try:
            result = future.result()
        except BrokenProcessPool as error:
            self._failed_starts = 0 if process.started else self._failed_starts + 1
            process.close(kill=True)
            if self._failed_starts >= FAILED_STARTS:
                raise WorkersGone(
                    f"{FAILED_STARTS} worker processes in a row died while they started"
                ) from error
            raise WorkerDied("the worker process died") from error
        finally:
            if future.done():
                process.busy = False
        self._failed_starts = 0
        return result

    def discard(self, future: Future[Any]) -> None:
        """Ends the worker that the function was given to."""
        process = self._process_of(future)
        if process.busy:
            process.kill()
        else:
            process.close(kill=True)

    def withdraw(self, futures: Iterable[Future[Any]]) -> list[Future[Any]]:
        """Takes nothing back, since every function begins at once."""
        return []

    def age(self, future: Future[Any]) -> float:
        """Returns the seconds (s) since the function was given to its worker."""
        return time.monotonic() - self._process_of(future).submit_time

    def close(self, *, kill: bool = False) -> None:
        """Ends the workers: when they are idle, or at once."""
        if kill:
            for child in multiprocessing.active_children():
                child.kill()
        for process in self._processes:
            process.close(kill=kill)

    def _process_of(self, future: Future[Any]) -> WorkerProcess:
        return next(process for process in self._processes if process.latest is future)
