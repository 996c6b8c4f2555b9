"""Computes certificates side by side in the pool that also runs trials; see `run/pool.py` for what
it promises.

A certificate that fails, or whose process dies twice, does not keep the others from being computed.
A caller that stops early ends the processes.
"""

from collections.abc import Callable, Generator, Sequence
from typing import Any

from ..errors import first_line
from ..run.local import LocalWorkers
from ..run.log import log_event
from ..run.plan import Chunk, NamedTask
from ..run.pool import Pool
from ..run.worker import Failure, WorkerSetup
from ..verify.compute import CertificateOutcome, compute_certificate


def certify_all(
    names: Sequence[str], seed: int, workers: int, work: Callable[..., Any] = compute_certificate
) -> Generator[CertificateOutcome]:
    """Yields the outcome of every name as it arrives; raises `WorkersGone` if no process can be
    started.
    """
    tasks = [NamedTask(name, {"name": name, "seed": seed}) for name in names]
    processes = LocalWorkers(min(workers, len(names)), WorkerSetup([], {}))
    with Pool(work, processes, log_event) as pool:
        for batch in pool.run([Chunk(task, (0,)) for task in tasks]):
            if isinstance(batch.outcome, Failure):
                error = first_line(batch.outcome.error)
                yield CertificateOutcome(batch.job.id, None, error, 0.0)
            else:
                yield batch.outcome
