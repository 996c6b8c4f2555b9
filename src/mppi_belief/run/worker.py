"""Runs in a worker process: sets it up once, then calls functions within a time limit.

Only plain data goes back: an exception that cannot be pickled or unpickled would look like the
death of the worker.
"""

import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from ..config import environment
from ..config.targets import allow
from ..errors import ConfigError
from ..results.provenance import machine
from . import signals


class WorkerSetup(NamedTuple):
    """Holds what a worker is given before any work is imported."""

    import_paths: Sequence[str]  # folders that are added to its module search path
    variables: dict[str, str]  # environment variables


class Failure(NamedTuple):
    """Says why trials have no result."""

    status: str  # "error", "crashed" or "timeout"
    error: str  # one line


Trials = tuple[int, ...]  # numbers of trials, ascending
TrialsOutcome = tuple[Trials, Any]  # a batch of trials, with its result or `Failure`


class ChunkReport(NamedTuple):
    """Says what became of the trials of a chunk."""

    outcomes: list[TrialsOutcome]  # of each batch that was begun
    machine: dict[str, Any]  # see `results.provenance.machine`
    seconds: float  # s, wall time of the chunk
    unfinished: Trials = ()  # trials not begun, since one before them hangs in this process
    mistake: str | None = None  # of the user or of the machine, which is no trial's own fault


class TimeLimitExceeded(Exception):
    """Says that a function took too long; its thread still runs."""


def apply_setup(setup: WorkerSetup) -> None:
    """Takes over what a worker is given, before it imports JAX."""
    environment.remove_unsafe()
    os.environ.update(setup.variables)
    allow(setup.import_paths)


def start_worker(setup: WorkerSetup) -> None:
    """Sets up a worker of this machine: it ignores signals, and ends when its parent does."""
    signals.ignore()
    apply_setup(setup)
    parent = multiprocessing.parent_process()
    if parent is None:
        raise RuntimeError("start_worker must be called in a child process")

    def die_with(parent: multiprocessing.process.BaseProcess) -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=die_with, args=(parent,), daemon=True).start()


def confirm_start() -> None:
    """Does nothing: a worker that answers has started."""


def run_chunk(
    work: Callable[..., Any],
    config: dict[str, Any],
    batches: Sequence[Trials],
    seconds: float | None,
) -> ChunkReport:
    """Calls `work(config, trials)` for every batch of trials, each within a time limit (s; None:
    any time).
    """
    start_time = time.monotonic()
    outcomes: list[TrialsOutcome] = []
    unfinished: Trials = ()
    mistake: str | None = None
    for index, trials in enumerate(batches):
        try:
            outcome = call_within(seconds, work, config, trials)
        except ConfigError as error:
            mistake = str(error)
            break
        except TimeLimitExceeded as error:
            outcomes.append((trials, Failure("timeout", str(error))))
            unfinished = sum(batches[index + 1 :], ())
            break
        except Exception as error:
            outcome = Failure("error", f"{type(error).__name__}: {error}")
        outcomes.append((trials, outcome))
    return ChunkReport(outcomes, machine(), time.monotonic() - start_time, unfinished, mistake)


def call_within(seconds: float | None, function: Callable[..., Any], *args: Any) -> Any:
    """Returns or raises what `function` does; raises `TimeLimitExceeded` after so many seconds (s;
    None: never).

    The function runs in a thread of its own, since nothing else in the process could look at the
    clock meanwhile.
    """
    if seconds is None:
        return function(*args)
    results: list[tuple[Any, BaseException | None]] = []

    def run() -> None:
        try:
            results.append((function(*args), None))
        except BaseException as error:
            results.append((None, error))

    thread = threading.Thread(target=run, daemon=True)
    deadline = time.monotonic() + seconds
    thread.start()
    remaining = seconds
    while thread.is_alive() and remaining > 0:
        thread.join(min(remaining, threading.TIMEOUT_MAX))
        remaining = deadline - time.monotonic()
    if not results:
        raise TimeLimitExceeded(not_done_after(seconds))
    result, error = results[0]
    if error is not None:
        raise error
    return result


def not_done_after(seconds: float) -> str:
    """Returns the text of the error of a trial that took too long."""
    return f"not done after {seconds:g} s"
