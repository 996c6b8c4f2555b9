"""What happens in a worker process: it is set up once, and does what it is sent within a time.

Only plain data goes back: an exception that cannot be pickled, or not unpickled, would pass for the worker's death.
"""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from ..config.cell import batches
from ..config.targets import allow
from ..errors import ConfigError
from ..results.provenance import machine
from .signals import STOPPING


class Setup(NamedTuple):
    """What a worker is given before any work is imported: folders that are added to its module search path,
    environment variables."""

    import_paths: Sequence[str]
    variables: dict[str, str]


class Lost(NamedTuple):
    """Why trials have no result: `status` is "error", "crashed" or "timeout"."""

    status: str
    error: str


class Report(NamedTuple):
    """What became of the trials of a chunk.

    done        batches of trials, each with what it gave or `Lost`
    where       host and processor
    seconds     that it took
    unfinished  trials that were not begun, since one before them hangs; its thread still runs in the worker
    mistake     what is wrong with the person's input or with the machine, which is no trial's own fault
    """

    done: list[tuple[tuple[int, ...], Any]]
    where: dict[str, str]
    seconds: float
    unfinished: tuple[int, ...] = ()
    mistake: str | None = None


def enter(setup: Setup) -> None:
    """Take over what a worker is given."""
    os.environ.update(setup.variables)
    allow(setup.import_paths)


def start_worker(setup: Setup) -> None:
    """Begin a worker on this machine: it leaves signals to its parent, and dies with it."""
    for number in STOPPING:
        signal.signal(number, signal.SIG_IGN)
    enter(setup)
    parent = multiprocessing.parent_process()
    if parent is None:
        raise RuntimeError("a worker has a parent process")

    def die_with(parent: multiprocessing.process.BaseProcess) -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=die_with, args=(parent,), daemon=True).start()


def ready() -> None:
    """A worker that answers has started."""


def run_chunk(
    work: Callable[..., Any], config: dict[str, Any], trials: Sequence[int], seconds: float | None
) -> Report:
    """Do `work(config, batch)` for every batch of trials, each within so many seconds (None: however long it takes)."""
    together, began = [*batches(trials, config["batch"])], time.monotonic()
    done: list[tuple[tuple[int, ...], Any]] = []
    for at, batch in enumerate(together):
        try:
            outcome = within(seconds, work, config, batch)
        except ConfigError as error:
            return Report(done, machine(), time.monotonic() - began, mistake=str(error))
        except Overtime as late:
            done.append((batch, Lost("timeout", str(late))))
            left = tuple(trial for later in together[at + 1 :] for trial in later)
            return Report(done, machine(), time.monotonic() - began, left)
        except Exception as error:
            outcome = Lost("error", f"{type(error).__name__}: {error}")
        done.append((batch, outcome))
    return Report(done, machine(), time.monotonic() - began)


class Overtime(Exception):
    """A function took too long; its thread still runs."""


def within(seconds: float | None, function: Callable[..., Any], *args: Any) -> Any:
    """What `function` returns or raises; raises `Overtime` if that takes longer than so many seconds.

    It runs in a thread of its own, for nothing else in a process could look at the clock meanwhile.
    """
    if seconds is None:
        return function(*args)
    ended: list[tuple[Any, BaseException | None]] = []

    def run() -> None:
        try:
            ended.append((function(*args), None))
        except BaseException as error:
            ended.append((None, error))

    thread, until = threading.Thread(target=run, daemon=True), time.monotonic() + seconds
    thread.start()
    while thread.is_alive() and (left := until - time.monotonic()) > 0:
        thread.join(min(left, threading.TIMEOUT_MAX))
    if not ended:
        raise Overtime(f"not done after {seconds:g} s")
    result, error = ended[0]
    if error is not None:
        raise error
    return result
