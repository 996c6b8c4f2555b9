"""Certificates computed side by side in a pool of processes. The runner promises:

* a certificate that fails does not keep the others from being computed;
* where a process dies, the certificates under way are computed once more, each in a process of its
  own;
* a caller that stops early ends the processes.
"""

import multiprocessing
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
from typing import NamedTuple

import jax

from ..numerics.dispatch import compute_in_calling_thread
from ..results.certificate import Certificate


class CertificateOutcome(NamedTuple):
    """Holds the certificate of one module, or the error that prevented it."""

    name: str
    certificate: Certificate | None
    error: str  # one line, "" if there is a certificate
    seconds: float  # computing time


def compute_certificate(name: str, seed: int) -> CertificateOutcome:
    """Computes the certificate of one module of `verify.certificates`, in double precision."""
    start = time.perf_counter()
    compute_in_calling_thread()
    try:
        with jax.enable_x64(True):
            module = import_module(f"mppi_belief.verify.certificates.{name}")
            certificate = module.certify(seed)
    except Exception as error:
        return _failed(name, error, time.perf_counter() - start)
    return CertificateOutcome(name, certificate, "", time.perf_counter() - start)


def certify_all(
    names: Sequence[str], seed: int, workers: int, initializer: Callable[[], object]
) -> Generator[CertificateOutcome]:
    """Yields the outcome of every name as it arrives; `initializer` starts each worker process."""
    suspects = []
    for name, outcome in _outcomes_of_pool(names, seed, workers, initializer):
        if outcome is None:
            suspects.append(name)
        else:
            yield outcome
    for suspect in suspects:
        for name, outcome in _outcomes_of_pool([suspect], seed, 1, initializer):
            yield outcome or _failed(name, BrokenProcessPool("the process died twice"), 0.0)


def _outcomes_of_pool(
    names: Sequence[str], seed: int, workers: int, initializer: Callable[[], object]
) -> Generator[tuple[str, CertificateOutcome | None]]:
    """Yields each name with its outcome, None where its process died."""
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(workers, len(names)), context, initializer=initializer)
    try:
        waiting: dict[Future[CertificateOutcome], str] = {
            pool.submit(compute_certificate, name, seed): name for name in names
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


def _failed(name: str, error: Exception, seconds: float) -> CertificateOutcome:
    line = next(iter(str(error).splitlines()), "")
    return CertificateOutcome(name, None, f"{type(error).__name__}: {line}", seconds)
