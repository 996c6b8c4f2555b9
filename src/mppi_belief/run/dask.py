"""Workers of a Dask scheduler: on other machines, or on this one, each a process with one thread.

The scheduler runs already (`executor.address`), or is started here, with workers in jobs of Slurm
or on this machine. Dask brings functions to workers and results back. Which trials are run, what is
done about a death, and what is written is decided by the pool, as with processes of our own.
"""

import contextlib
import logging
import pickle
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import CancelledError, Future
from importlib.metadata import version
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

from ..errors import ConfigError
from .dask_worker import SAME_VERSIONS, exit_worker, one_line, run_in_worker
from .log import log_on_terminal
from .worker import WorkerSetup
from .workers import WorkerDied, WorkersGone

POLL_INTERVAL = 1.0  # s between two questions which workers are connected
CLOSE_TIMEOUT = 10.0  # s that a scheduler may take to end


def _replace_nothing(names: Collection[Any]) -> None:
    """Does nothing: these workers come and go by themselves."""


class SchedulerConnection(NamedTuple):
    """Holds a connection to a scheduler."""

    client: Any  # distributed.Client
    end: Callable[[], None]  # what to do when the run ends
    # called with the names of the connected workers when these have been asked for
    replace_missing: Callable[[Collection[Any]], None] = _replace_nothing


class DaskWorkers:
    """Uses the workers of a Dask scheduler; see `Workers` for what its methods do.

    `connect()` is called when the workers are first needed.
    """

    own_environment = True
    # s; starting a chunk takes 20 to 30 ms, and one scheduler starts a hundred per second.
    grain = 10.0

    def __init__(
        self, connect: Callable[[], SchedulerConnection], count: int, setup: WorkerSetup
    ) -> None:
        self.count = count
        self._connect = connect
        self._connection: SchedulerConnection | None = None
        versions = {name: version(name) for name in SAME_VERSIONS}
        self._setup = pickle.dumps((setup, versions, sys.version_info[:2]))
        self._tasks: dict[Future[Any], Any] = {}  # Dask's own futures
        self._addresses: WeakKeyDictionary[Future[Any], str] = WeakKeyDictionary()
        self._connected = 0  # workers
        self._poll_time: float | None = None  # s, by the monotonic clock; None: ask again
        self._waiting_logged = False

    @property
    def connection(self) -> SchedulerConnection:
        """Returns the connection, made when it is first asked for; raises `ConfigError`,
        `WorkersGone`.
        """
        if self._connection is None:
            _silence_libraries()
            self._connection = self._connect()
        return self._connection

    def room(self) -> int:
        """Returns how many more functions the connected workers would take.

        Each takes one, so that no function dies with another's worker.
        """
        now = time.monotonic()
        if self._poll_time is None or now - self._poll_time > POLL_INTERVAL:
            self._poll_workers(now)
        return self._connected - len(self._tasks)

    def _poll_workers(self, now: float) -> None:
        with _scheduler_reached():
            info = self.connection.client.scheduler_info(n_workers=-1)
        workers = info["workers"].values()
        self._connected = len(workers)
        self._poll_time = now
        self.connection.replace_missing([worker["name"] for worker in workers])
        if not workers and not self._waiting_logged:
            self._waiting_logged = True
            number = f"{self.count} workers" if self.count > 1 else "a worker"
            log_on_terminal(f"waiting for {number}")

    def submit(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        """Lets a worker call a function."""
        future: Future[Any] = Future()
        work = pickle.dumps((function, args))
        client = self.connection.client
        with _scheduler_reached():
            task = client.submit(run_in_worker, self._setup, work, pure=False, retries=0)
        self._tasks[future] = task
        task.add_done_callback(lambda _: future.set_result(None))
        return future

    def collect(self, future: Future[Any]) -> Any:
        """Returns or raises what the function did.

        Raises `WorkerDied`, `WorkersGone`, `ConfigError`.
        """
        from distributed import KilledWorker

        task = self._tasks.pop(future)
        try:
            with _scheduler_reached():
                address, result, raised = task.result()
        except KilledWorker as error:
            self._poll_time = None
            raise WorkerDied("the worker process died") from error
        except WorkersGone:
            raise
        except Exception as error:  # Dask's own, or of a worker that lacks what it needs
            raise ConfigError(f"a worker cannot do this: {one_line(error)}") from error
        self._addresses[future] = address
        if raised is not None:
            raise raised
        return result

    def discard(self, future: Future[Any]) -> None:
        """Ends the worker that got a function; its nanny, if it has one, starts another."""
        if future in self._addresses:
            self._poll_time = None
            addresses = [self._addresses[future]]
            with _scheduler_reached():
                self.connection.client.run(
                    exit_worker, workers=addresses, wait=False, on_error="ignore"
                )

    def withdraw(self, futures: Iterable[Future[Any]]) -> list[Future[Any]]:
        """Takes back functions that no worker has begun."""
        with _scheduler_reached():
            processing = self.connection.client.processing()
        begun: set[Any] = set()
        for keys in processing.values():
            begun.update(keys)
        waiting = [
            future
            for future in futures
            if self._tasks[future].key not in begun and not future.done()
        ]
        for future in waiting:
            self._tasks.pop(future).cancel()
        return waiting

    def age(self, future: Future[Any]) -> float:
        """Returns 0, since only the worker knows when it began."""
        return 0.0

    def close(self, *, kill: bool = False) -> None:
        """Leaves the scheduler, and ends one that was started here.

        Errors are ignored, since the results are written.
        """
        connection = self._connection
        self._connection = None
        if connection is not None:
            with contextlib.suppress(Exception):
                connection.client.close(timeout=CLOSE_TIMEOUT)
            with contextlib.suppress(Exception):
                connection.end()


def _silence_libraries() -> None:
    """Lets the pool alone write events.

    The libraries are imported first, since their loggers get levels of their own then.
    """
    import distributed  # noqa: F401

    for name in ("distributed", "tornado", "asyncio", *logging.root.manager.loggerDict):
        if name.partition(".")[0] in ("distributed", "tornado", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL)


def close_cluster(cluster: Any) -> None:
    """Ends a scheduler of this process, with the workers that it started."""
    cluster.close(timeout=CLOSE_TIMEOUT)


@contextlib.contextmanager
def _scheduler_reached() -> Iterator[None]:
    """Raises `WorkersGone` where the scheduler cannot be reached."""
    try:
        yield
    except (CancelledError, OSError) as error:
        raise WorkersGone(f"the cluster's scheduler is gone ({type(error).__name__})") from error
