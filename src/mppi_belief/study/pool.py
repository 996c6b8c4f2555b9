"""Who runs it: a process pool that survives its workers.

A killed worker breaks a `ProcessPoolExecutor` and takes the innocent chunks in flight with it. Those
are then run one at a time in a fresh pool; a chunk that breaks that too is halved, down to the one
trial, which after a second strike is given up as crashed.
"""

import multiprocessing
import os
import signal
import sys
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, NamedTuple

from ..settings import ConfigError
from .plan import Chunk
from .signals import STOPPING

STRIKES = 2


class WorkerDied(Exception):
    """A worker ended before its function did."""


class Lost(NamedTuple):
    """Why a chunk has no result: `status` is "error" or "crashed"."""

    status: str
    error: str


class Pool:
    """Runs `work(config, trials)` on chunks; `import_paths` are added to the workers' module search path, `variables`
    to their environment."""

    def __init__(
        self,
        work: Callable[..., Any],
        workers: int,
        import_paths: list[str],
        log: Callable[[str], None],
        variables: dict[str, str] | None = None,
    ) -> None:
        self._work, self._workers, self._log = work, workers, log
        self._start = (import_paths, variables or {})
        self._executor: ProcessPoolExecutor | None = None
        self._stopping = threading.Event()

    def stop(self) -> None:
        """Start no more chunks; those running are finished."""
        self._stopping.set()

    def close(self, *, kill: bool = False) -> None:
        """End the workers: when they are idle, or at once."""
        if kill:
            for child in multiprocessing.active_children():
                child.kill()
        if self._executor is not None:
            self._executor.shutdown(wait=True, cancel_futures=True)
            self._executor = None

    def run(self, chunks: Iterable[Chunk]) -> Iterator[tuple[Chunk, Any]]:
        """Yield every chunk with its result, or with `Lost`, as they come; raises `ConfigError` where the work does."""
        fresh, suspects = deque(chunks), deque[Chunk]()
        strikes: Counter[tuple[str, int]] = Counter()
        running: dict[Future[Any], Chunk] = {}
        while running or ((fresh or suspects) and not self._stopping.is_set()):
            self._fill(running, fresh, suspects)
            alone = len(running) == 1 and bool(suspects)
            broken = []
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                chunk = running.pop(future)
                try:
                    yield chunk, future.result()
                except BrokenProcessPool:
                    broken.append(chunk)
                except ConfigError:  # no trial's own fault: nothing of this chunk may count as done
                    raise
                except Exception as error:
                    yield chunk, Lost("error", f"{type(error).__name__}: {error}")
            if alone and not broken:
                suspects.popleft()
            if broken:
                yield from self._recover([*broken, *running.values()], alone, suspects, strikes)
                running.clear()

    def call(self, function: Callable[..., Any], *args: Any) -> Any:
        """Run one function in a worker while the others are idle; raises `WorkerDied`."""
        try:
            return self._submit(function, *args).result()
        except BrokenProcessPool as error:
            self.close(kill=True)
            raise WorkerDied("the worker process died") from error

    def _fill(self, running: dict[Future[Any], Chunk], fresh: deque[Chunk], suspects: deque[Chunk]) -> None:
        """Keep every worker busy and one chunk waiting; a suspect runs alone and stays in its queue till cleared."""
        while not self._stopping.is_set():
            if suspects:
                if not running:
                    running[self._submit(self._work, suspects[0].cell.config, suspects[0].trials)] = suspects[0]
                return
            if not fresh or len(running) > self._workers:
                return
            chunk = fresh.popleft()
            running[self._submit(self._work, chunk.cell.config, chunk.trials)] = chunk

    def _submit(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        # children inherit the mask: a Ctrl-C that reaches them while Python starts must not print a traceback
        before = signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)
        try:
            if self._executor is None:
                context = multiprocessing.get_context("spawn")
                self._executor = ProcessPoolExecutor(
                    self._workers, context, initializer=start_worker, initargs=self._start
                )
            try:
                return self._executor.submit(function, *args)
            except BrokenProcessPool as error:
                failed: Future[Any] = Future()
                failed.set_exception(error)
                return failed
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def _recover(
        self, victims: list[Chunk], alone: bool, suspects: deque[Chunk], strikes: Counter[tuple[str, int]]
    ) -> Iterator[tuple[Chunk, Lost]]:
        self.close(kill=True)  # the survivors ignore the SIGTERM that a broken pool sends them
        if not alone:
            self._log(f"a worker died; running again, one at a time: {len(victims)} chunk(s)")
            suspects.extend(victims)
            return
        (culprit,) = victims
        suspects.popleft()
        if len(culprit.trials) > 1:
            middle = len(culprit.trials) // 2
            self._log(f"a worker died in trials {culprit.trials[0]}..{culprit.trials[-1]}; looking for the one")
            suspects.extendleft(
                culprit._replace(trials=part) for part in (culprit.trials[middle:], culprit.trials[:middle])
            )
            return
        accused = (culprit.cell.id, culprit.trials[0])
        strikes[accused] += 1
        if strikes[accused] < STRIKES:
            suspects.appendleft(culprit)
            return
        self._log(f"trial {culprit.trials[0]} killed its worker {STRIKES} times; given up")
        yield culprit, Lost("crashed", f"the worker process died {STRIKES} times in this trial")


def start_worker(import_paths: list[str], variables: dict[str, str]) -> None:
    """Leave signals to the parent, and die with it. The variables are set before any work is imported."""
    for number in STOPPING:
        signal.signal(number, signal.SIG_IGN)
    os.environ.update(variables)
    sys.path[:0] = import_paths
    parent = multiprocessing.parent_process()
    if parent is None:
        raise RuntimeError("a worker has a parent process")

    def die_with(parent: multiprocessing.process.BaseProcess) -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=die_with, args=(parent,), daemon=True).start()
