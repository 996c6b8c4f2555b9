"""Runs in a worker of a Dask scheduler: checks it, sets it up once, and calls functions."""

import os
import pickle
import sys
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ..errors import ConfigError, first_line
from .worker import WorkerSetup, apply_setup

# the bits of a result depend on the versions of these
SAME_VERSIONS = ("mppi-belief", "jax", "jaxlib", "numpy")
applied_setups: list[WorkerSetup] = []  # of this worker


def run_in_worker(setup: bytes, work: bytes) -> tuple[str, Any, Exception | None]:
    """Sets up the worker that it runs in if that is new, and calls a function.

    Returns the worker's address, the result or None, and the error or None.

    The function comes pickled, since unpickling it imports JAX, which must find its environment.
    """
    from distributed import get_worker

    worker = get_worker()
    try:
        requested, versions, python = pickle.loads(setup)
        if requested not in applied_setups:
            _check_worker(requested, versions, python, worker)
            apply_setup(requested)
            applied_setups.append(requested)
        function, args = pickle.loads(work)
        return worker.address, function(*args), None
    except Exception as error:
        return worker.address, None, _picklable(error)


def _picklable(error: Exception) -> Exception:
    """Returns an exception that the other side can certainly unpickle."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(one_line(error))
    return error


def _check_worker(
    setup: WorkerSetup, versions: Mapping[str, str], python: tuple[int, int], worker: Any
) -> None:
    """Raises `ConfigError` for a worker that would not give the same bits.

    One that runs several functions at a time is refused, too.
    """
    name = f"the worker {worker.address}"
    for package, wanted in versions.items():
        installed = version(package)
        if installed != wanted:
            raise ConfigError(f"{name} has {package} {installed}, here it is {wanted}")
    if sys.version_info[:2] != python:
        raise ConfigError(f"{name} runs Python {sys.version_info[0]}.{sys.version_info[1]}")
    threads = worker.state.nthreads
    if threads != 1:
        raise ConfigError(f"{name} has {threads} threads: start it with --nthreads 1")
    for folder in setup.import_paths:
        if not Path(folder).is_dir():
            raise ConfigError(f"--config-dir: {name} does not see {folder}; it must be shared")
    other_environment = applied_setups and applied_setups[0].variables != setup.variables
    if other_environment and "jax" in sys.modules:
        raise ConfigError(f"{name} was set up for another environment: start it again")


def one_line(error: Exception) -> str:
    """Returns the name of an exception and the first line of its message."""
    return f"{type(error).__name__}: {first_line(error)}"


async def exit_worker() -> None:
    """Ends a worker whose thread hangs.

    It is a coroutine, since Dask waits for the answer of anything else.
    """
    os._exit(1)
