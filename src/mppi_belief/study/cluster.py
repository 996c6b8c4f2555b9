"""Workers on other machines, or on this one as if they were: Dask's, each a process with one thread.

A scheduler that runs (`executor.address`), jobs of Slurm that are asked for here, or a cluster on this machine. Dask
brings functions to workers and results back; which trials are run, what is done about a death, and what is written is
the pool's business and the same as with processes of our own.
"""

import logging
import os
import pickle
import sys
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import CancelledError, Future
from importlib.metadata import version
from typing import Any
from weakref import WeakKeyDictionary

from ..settings import ConfigError
from .lanes import WorkerDied, WorkersGone
from .worker import Setup, enter

SAME = ("mppi-belief", "jax", "jaxlib", "numpy")  # what the bits of a result depend on
_entered: list[Setup] = []


class Cluster:
    """The workers of a Dask scheduler; `connect()` returns its client and is called when they are first needed."""

    elsewhere = True
    grain = 10.0  # s; starting a chunk takes 20 to 30 ms, and one scheduler starts a hundred in a second

    def __init__(self, connect: Callable[[], Any], count: int, setup: Setup) -> None:
        self.count = count
        self._connect, self._client = connect, None
        self._setup = pickle.dumps((setup, {name: version(name) for name in SAME}, sys.version_info[:2]))
        self._tasks: dict[Future[Any], Any] = {}
        self._homes: WeakKeyDictionary[Future[Any], str] = WeakKeyDictionary()

    @property
    def client(self) -> Any:
        """The connection, made when it is first asked for; raises `ConfigError`, `WorkersGone`."""
        if self._client is None:
            logging.getLogger("distributed").setLevel(logging.CRITICAL)  # the pool says in its own words what happens
            self._client = self._connect()
        return self._client

    def room(self) -> int:
        """How many chunks it would take: one for every worker that is there, so that none dies with another's worker;
        before any is there, one for each that will come."""
        here = len(self.client.scheduler_info(n_workers=-1)["workers"])
        return (here or self.count) - len(self._tasks)

    def submit(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        """Let a worker do something."""
        future: Future[Any] = Future()
        task = self.client.submit(run_there, self._setup, pickle.dumps((function, args)), pure=False, retries=0)
        self._tasks[future] = task
        task.add_done_callback(lambda _: future.set_result(None))
        return future

    def collect(self, future: Future[Any]) -> Any:
        """What came of it; raises `WorkerDied`, `WorkersGone`, `ConfigError`, or what the function did."""
        from distributed import KilledWorker

        task = self._tasks.pop(future)
        try:
            self._homes[future], result = task.result()
        except KilledWorker as error:
            raise WorkerDied("the worker process died") from error
        except (CancelledError, OSError) as error:
            raise WorkersGone(f"the cluster's scheduler is gone ({type(error).__name__})") from error
        return result

    def discard(self, future: Future[Any]) -> None:
        """End the worker that had `future`; where a nanny looks after it, that starts another."""
        if future in self._homes:
            self.client.run(os._exit, 1, workers=[self._homes[future]], wait=False)

    def withdraw(self, futures: Iterable[Future[Any]]) -> list[Future[Any]]:
        """Take back what no worker has begun; what was taken back."""
        begun = {key for keys in self.client.processing().values() for key in keys}
        waiting = [future for future in futures if self._tasks[future].key not in begun and not future.done()]
        for future in waiting:
            self._tasks.pop(future).cancel()
        return waiting

    def age(self, future: Future[Any]) -> float:
        """Nobody here knows when a worker began; only the worker itself looks at the clock."""
        return 0.0

    def close(self, *, kill: bool = False) -> None:
        """Let go of the scheduler; a cluster that was started here is ended."""
        if self._client is not None:
            cluster, client, self._client = self._client.cluster, self._client, None
            client.close()
            if cluster is not None:
                cluster.close()


def run_there(setup: bytes, work: bytes) -> tuple[str, Any]:
    """In a worker: set it up if it is new, then do the work; its address with what that returns.

    The work comes packed, for unpacking it imports JAX, which must find its environment.
    """
    from distributed import get_worker

    worker = get_worker()
    given, versions, python = pickle.loads(setup)
    if given not in _entered:
        _check(versions, python, worker)
        if _entered and _entered[0].variables != given.variables and "jax" in sys.modules:
            raise ConfigError(f"the worker {worker.address} was set up for another environment: start it again")
        enter(given)
        _entered.append(given)
    function, args = pickle.loads(work)
    return worker.address, function(*args)


def _check(versions: Mapping[str, str], python: tuple[int, int], worker: Any) -> None:
    """Raise `ConfigError` where a worker would not give the same bits, or not one result at a time."""
    mine = {name: version(name) for name in SAME}
    for name, wanted in versions.items():
        if mine[name] != wanted:
            raise ConfigError(f"the worker {worker.address} has {name} {mine[name]}, here it is {wanted}")
    if sys.version_info[:2] != python:
        raise ConfigError(f"the worker {worker.address} runs Python {sys.version_info[0]}.{sys.version_info[1]}")
    if worker.state.nthreads != 1:
        raise ConfigError(
            f"the worker {worker.address} has {worker.state.nthreads} threads: start it with --nthreads 1"
        )
