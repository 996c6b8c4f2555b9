"""Certificates side by side in a pool of processes; a failure of one does not keep the others from being seen."""

import multiprocessing
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
from typing import NamedTuple

import jax

from ..results.certificate import Certificate


class CertificateOutcome(NamedTuple):
    """The certificate of one module, or the error in one line that kept it from being computed; and the seconds."""

    name: str
    certificate: Certificate | None
    error: str
    seconds: float


def certify(name: str, seed: int) -> CertificateOutcome:
    """Compute the certificate of one module of `mppi_belief.verify`, in double precision."""
    began = time.perf_counter()
    try:
        with jax.enable_x64(True):
            made = import_module(f"mppi_belief.verify.certificates.{name}").certify(seed)
    except Exception as error:
        return _lost(name, error, time.perf_counter() - began)
    return CertificateOutcome(name, made, "", time.perf_counter() - began)


def certify_all(
    names: Sequence[str], seed: int, workers: int, initializer: Callable[[], object]
) -> Generator[CertificateOutcome]:
    """Yield the certificate of every name as it is done; `initializer` starts each of the `workers` processes.

    Where a process dies, those that were under way are computed once more, each in a process of its own. A caller
    that stops early ends the processes.
    """
    suspects = []
    for name, done in _in_pool(names, seed, workers, initializer):
        if done is None:
            suspects.append(name)
        else:
            yield done
    for suspect in suspects:
        for name, done in _in_pool([suspect], seed, 1, initializer):
            yield done or _lost(name, BrokenProcessPool("the process died twice"), 0.0)


def _in_pool(
    names: Sequence[str], seed: int, workers: int, initializer: Callable[[], object]
) -> Generator[tuple[str, CertificateOutcome | None]]:
    """Each name with what came of it, None where its process died."""
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(workers, len(names)), context, initializer=initializer)
    try:
        waiting: dict[Future[CertificateOutcome], str] = {
            pool.submit(certify, name, seed): name for name in names
        }
        for future in as_completed(waiting):
            died = isinstance(future.exception(), BrokenProcessPool)
            yield waiting[future], None if died else future.result()
    except BaseException:
        for process in multiprocessing.active_children():
            process.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _lost(name: str, error: Exception, seconds: float) -> CertificateOutcome:
    line = next(iter(str(error).splitlines()), "")
    return CertificateOutcome(name, None, f"{type(error).__name__}: {line}", seconds)
