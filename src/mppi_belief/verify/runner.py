"""Certificates side by side in a pool of processes; a failure of one does not keep the others from being seen."""

import multiprocessing
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from importlib import import_module
from typing import NamedTuple

import jax

from ..certificate import Certificate, Check


class Done(NamedTuple):
    """A certificate and the seconds it took."""

    certificate: Certificate
    seconds: float


def certify(name: str, seed: int) -> Done:
    """Compute the certificate of one module of `mppi_belief.verify`, in double precision.

    What it raises becomes a check that fails.
    """
    began = time.perf_counter()
    try:
        with jax.enable_x64(True):
            made = import_module(f"mppi_belief.verify.{name}").certify(seed)
    except Exception as error:
        made = _failed(name, error)
    return Done(made, time.perf_counter() - began)


def certify_all(names: Sequence[str], seed: int, workers: int, initializer: Callable[[], object]) -> Iterator[Done]:
    """Yield every certificate of `names` as it is done; `initializer` starts each of the `workers` processes.

    A caller that stops early ends the processes.
    """
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(workers, len(names)), context, initializer=initializer)
    try:
        waiting = {pool.submit(certify, name, seed): name for name in names}
        for future in as_completed(waiting):
            error = future.exception()
            yield future.result() if error is None else Done(_failed(waiting[future], error), 0.0)
    except BaseException:
        for process in multiprocessing.active_children():
            process.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _failed(name: str, error: BaseException) -> Certificate:
    line = next(iter(str(error).splitlines()), "")
    raised = Check(f"{type(error).__name__}: {line}", float("nan"), 0.0, 0.0, "it must not raise")
    return Certificate(name, name, "The certificate could not be computed.", [raised])
