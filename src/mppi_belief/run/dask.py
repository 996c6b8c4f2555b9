"""Workers on other machines, or on this one as if they were: Dask's, each a process with one thread.

A scheduler that runs (`executor.address`), jobs of Slurm that are asked for here, or a cluster on this machine. Dask
brings functions to workers and results back; which trials are run, what is done about a death, and what is written is
the pool's business and the same as with processes of our own.
"""

import contextlib
import logging
import os
import pickle
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from concurrent.futures import CancelledError, Future
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

from ..errors import ConfigError
from .local import WorkerDied, WorkersGone
from .log import note
from .worker import Setup, enter

SAME = ("mppi-belief", "jax", "jaxlib", "numpy")  # what the bits of a result depend on
GLANCE = 1.0  # s for which it is taken as known which workers are there
CLOSING = 10.0  # s that a scheduler may take to end
_entered: list[Setup] = []


def _leave(names: Collection[Any]) -> None:
    """Whoever comes and goes does it by itself."""


class Site(NamedTuple):
    """A scheduler: its client, what to do at the end, and now and then with the names of the workers that are there."""

    client: Any
    end: Callable[[], None]
    tend: Callable[[Collection[Any]], None] = _leave


class Cluster:
    """The workers of a Dask scheduler; `connect()` is called when they are first needed."""

    elsewhere = True
    grain = 10.0  # s; starting a chunk takes 20 to 30 ms, and one scheduler starts a hundred in a second

    def __init__(self, connect: Callable[[], Site], count: int, setup: Setup) -> None:
        self.count = count
        self._connect = connect
        self._site: Site | None = None
        self._setup = pickle.dumps(
            (setup, {name: version(name) for name in SAME}, sys.version_info[:2])
        )
        self._tasks: dict[Future[Any], Any] = {}
        self._homes: WeakKeyDictionary[Future[Any], str] = WeakKeyDictionary()
        self._here, self._seen, self._waits = 0, 0.0, False

    @property
    def site(self) -> Site:
        """The connection, made when it is first asked for; raises `ConfigError`, `WorkersGone`."""
        if self._site is None:
            _hush()
            self._site = self._connect()
        return self._site

    def room(self) -> int:
        """How many chunks it would take: one for every worker that is there, so that none dies with another's."""
        now = time.monotonic()
        if now - self._seen > GLANCE or not self._seen:
            with _reached():
                workers = self.site.client.scheduler_info(n_workers=-1)["workers"].values()
            self._here, self._seen = len(workers), now
            self.site.tend([worker["name"] for worker in workers])
            if not workers and not self._waits:
                self._waits = True
                note(
                    f"waiting for {self.count} workers"
                    if self.count > 1
                    else "waiting for a worker"
                )
        return self._here - len(self._tasks)

    def submit(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        """Let a worker do something."""
        future: Future[Any] = Future()
        work = pickle.dumps((function, args))
        with _reached():
            task = self.site.client.submit(run_there, self._setup, work, pure=False, retries=0)
        self._tasks[future] = task
        task.add_done_callback(lambda _: future.set_result(None))
        return future

    def collect(self, future: Future[Any]) -> Any:
        """What came of it; raises `WorkerDied`, `WorkersGone`, `ConfigError`, or what the function did."""
        from distributed import KilledWorker

        task = self._tasks.pop(future)
        try:
            with _reached():
                self._homes[future], result, error = task.result()
        except KilledWorker as error:
            self._seen = 0.0
            raise WorkerDied("the worker process died") from error
        except WorkersGone:
            raise
        except Exception as error:  # Dask's own, or of a worker that lacks what it needs
            raise ConfigError(f"a worker cannot do this: {_line(error)}") from error
        if error is not None:
            raise error
        return result

    def discard(self, future: Future[Any]) -> None:
        """End the worker that had `future`; where a nanny looks after it, that starts another."""
        if future in self._homes:
            self._seen = 0.0
            with _reached():
                self.site.client.run(
                    _exit, workers=[self._homes[future]], wait=False, on_error="ignore"
                )

    def withdraw(self, futures: Iterable[Future[Any]]) -> list[Future[Any]]:
        """Take back what no worker has begun; what was taken back."""
        with _reached():
            begun = {key for keys in self.site.client.processing().values() for key in keys}
        waiting = [
            future
            for future in futures
            if self._tasks[future].key not in begun and not future.done()
        ]
        for future in waiting:
            self._tasks.pop(future).cancel()
        return waiting

    def age(self, future: Future[Any]) -> float:
        """Nobody here knows when a worker began; only the worker itself looks at the clock."""
        return 0.0

    def close(self, *, kill: bool = False) -> None:
        """Let go of the scheduler; a cluster that was started here is ended. Nothing that goes wrong matters now."""
        if self._site is not None:
            site, self._site = self._site, None
            with contextlib.suppress(Exception):
                site.client.close(timeout=CLOSING)
            with contextlib.suppress(Exception):
                site.end()


def _hush() -> None:
    """Let the pool alone say what happens; what says it otherwise has levels of its own once it is imported."""
    import distributed  # noqa: F401

    for name in ("distributed", "tornado", "asyncio", *logging.root.manager.loggerDict):
        if name.partition(".")[0] in ("distributed", "tornado", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL)


async def _exit() -> None:
    """In a worker whose thread hangs; Dask waits for the answer of anything that is not a coroutine."""
    os._exit(1)


def close_cluster(cluster: Any) -> None:
    """End a scheduler of this process, with the workers that it started."""
    cluster.close(timeout=CLOSING)


@contextlib.contextmanager
def _reached() -> Iterator[None]:
    """Raise `WorkersGone` where the scheduler cannot be reached."""
    try:
        yield
    except (CancelledError, OSError) as error:
        raise WorkersGone(f"the cluster's scheduler is gone ({type(error).__name__})") from error


def _line(error: Exception) -> str:
    return f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}"


def run_there(setup: bytes, work: bytes) -> tuple[str, Any, Exception | None]:
    """In a worker: set it up if it is new, then do the work; its address with what that returns or raises.

    The work comes packed, for unpacking it imports JAX, which must find its environment.
    """
    from distributed import get_worker

    worker = get_worker()
    try:
        given, versions, python = pickle.loads(setup)
        if given not in _entered:
            _check(given, versions, python, worker)
            enter(given)
            _entered.append(given)
        function, args = pickle.loads(work)
        return worker.address, function(*args), None
    except Exception as error:
        return worker.address, None, _portable(error)


def _portable(error: Exception) -> Exception:
    """An exception that the other side can certainly unpack."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(_line(error))
    return error


def _check(setup: Setup, versions: Mapping[str, str], python: tuple[int, int], worker: Any) -> None:
    """Raise `ConfigError` where a worker would not give the same bits, or not one result at a time."""
    mine = {name: version(name) for name in SAME}
    for name, wanted in versions.items():
        if mine[name] != wanted:
            raise ConfigError(
                f"the worker {worker.address} has {name} {mine[name]}, here it is {wanted}"
            )
    if sys.version_info[:2] != python:
        raise ConfigError(
            f"the worker {worker.address} runs Python {sys.version_info[0]}.{sys.version_info[1]}"
        )
    threads = worker.state.nthreads
    if threads != 1:
        raise ConfigError(
            f"the worker {worker.address} has {threads} threads: start it with --nthreads 1"
        )
    for folder in setup.import_paths:
        if not Path(folder).is_dir():
            raise ConfigError(
                f"--config-dir: the worker {worker.address} does not see {folder}; it must be shared"
            )
    if _entered and _entered[0].variables != setup.variables and "jax" in sys.modules:
        raise ConfigError(
            f"the worker {worker.address} was set up for another environment: start it again"
        )
