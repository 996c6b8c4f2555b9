"""Handles SIGINT (Ctrl-C) and SIGTERM, from the first import of a command to its last line.

1. `__main__` blocks both before it imports anything else (`block`): a signal during an import would
   end it with a traceback. Blocked signals wait.
2. `run` keeps them blocked (`held`) until it can stop politely (`polite_stop`): the first signal
   finishes the trials that run and writes them, the second ends the run at once.
3. `report`, `verify`, `results` and `replay` leave nothing half done, so they end at the first
   signal (`ended_by_signals`).
4. Workers ignore both (`ignore`), since a terminal sends Ctrl-C to the whole process group: the
   parent decides. Threads and processes that must never see a signal are started while both are
   blocked (`masked`). The system may then give a signal to another thread of the process, such as
   that of a progress bar, and Python would run its handler in the main thread nevertheless:
   handlers wait too (`_waits_while_masked`).
5. When all is done, `__main__` ignores them (`ignore`): the command ends anyway.

A command that a signal stops has the exit code 128 + number of the signal.
"""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType

STOPPING = {signal.SIGINT, signal.SIGTERM}
GRACE = 10.0  # s that a command has to end after a signal

Handler = Callable[[int, FrameType | None], None]


@dataclass
class MaskedSignals:
    """Holds what `masked` does in the main thread, the only one that runs handlers."""

    depth: int = 0  # number of `masked` blocks that have been entered
    waiting: list[int] = field(default_factory=list)  # signals whose handlers wait for their end


_masked_signals = MaskedSignals()


class StoppedAtOnce(BaseException):
    """Says that a second signal came.

    It may be raised in the middle of any call. Like KeyboardInterrupt it is no `Exception`, so what
    handles the errors of that call does not take it for one of them.
    """


class StopRequest:
    """Says whether a signal asked to stop."""

    number: int | None = None  # the first signal
    at_once: bool = False  # whether a second signal came
    accepts_second: bool = False  # whether a second signal may raise


def block() -> None:
    """Blocks both signals; those that come are answered when they are let in."""
    signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)
    for number in STOPPING:  # threads that start while signals are let in may get them later
        signal.signal(number, _do_nothing)


def ignore() -> None:
    """Ignores both signals from now on."""
    for number in STOPPING:
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def held() -> Iterator[None]:
    """Keeps signals waiting, since a half-done import answers them with a traceback; `polite_stop`
    lets them in.
    """
    mask_before = signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)
    try:
        yield
    finally:
        for number in signal.sigpending() & STOPPING:
            signal.sigwait({number})
        signal.pthread_sigmask(signal.SIG_SETMASK, mask_before)


@contextmanager
def masked() -> Iterator[None]:
    """Keeps signals waiting; threads and processes that are started meanwhile never get them from a
    terminal.
    """
    from multiprocessing import resource_tracker  # 40 ms that --help need not wait for

    # The first process to start would start the tracker, and that lets signals in again.
    resource_tracker.ensure_running()
    mask_before = signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)
    in_main_thread = threading.current_thread() is threading.main_thread()
    _masked_signals.depth += in_main_thread
    try:
        yield
    finally:
        _masked_signals.depth -= in_main_thread
        signal.pthread_sigmask(signal.SIG_SETMASK, mask_before)
        if in_main_thread and not _masked_signals.depth:
            _raise_waiting_signals()


def _waits_while_masked(handle: Handler) -> Handler:
    """Returns a handler that is called at the end of `masked` for a signal that comes meanwhile."""

    def handle_or_wait(number: int, frame: FrameType | None) -> None:
        if _masked_signals.depth:
            _masked_signals.waiting.append(number)
        else:
            handle(number, frame)

    return handle_or_wait


def _raise_waiting_signals() -> None:
    """Sends this process the signals again that have waited; each of them once."""
    numbers = dict.fromkeys(_masked_signals.waiting)
    _masked_signals.waiting.clear()
    for number in numbers:
        signal.raise_signal(number)


@contextmanager
def polite_stop(on_first: Callable[[], None]) -> Iterator[StopRequest]:
    """Calls `on_first` at the first signal and raises `StoppedAtOnce` in the block at the second.

    The exception ends no more than the block; handlers and mask are put back at its end.
    """
    stop = StopRequest()

    def handle(number: int, frame: FrameType | None) -> None:
        if stop.number is None:
            stop.number = number
            on_first()
        elif stop.accepts_second and not stop.at_once:
            stop.at_once = True
            raise StoppedAtOnce

    waiting_handler = _waits_while_masked(handle)
    handlers_before = {number: signal.signal(number, waiting_handler) for number in STOPPING}
    # Two signals that have waited count as one, and one that comes when all is over as none.
    mask_before = signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPPING)
    try:
        stop.accepts_second = True
        yield stop
    except StoppedAtOnce:
        pass
    finally:
        stop.accepts_second = False
        signal.pthread_sigmask(signal.SIG_SETMASK, mask_before)
        for number, handler in handlers_before.items():
            signal.signal(number, handler)


def ended_by_signals(
    command: Callable[[], int], on_stop: Callable[[], None], grace: float = GRACE
) -> int:
    """Runs a command that the first signal ends.

    Returns its exit code, or after `on_stop` 128 + number of the signal.

    The signal raises KeyboardInterrupt in the command. Imports and callbacks may swallow that
    exception, so the process ends after `grace` seconds in any case.
    """

    def stop(number: int, frame: FrameType | None) -> None:
        signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)  # a second signal changes nothing

        def end(*_: object) -> None:
            on_stop()
            os._exit(128 + number)

        signal.signal(signal.SIGALRM, end)
        signal.setitimer(signal.ITIMER_REAL, grace)
        raise KeyboardInterrupt(number)

    handlers = {number: signal.signal(number, _waits_while_masked(stop)) for number in STOPPING}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPPING)
        return command()
    except KeyboardInterrupt as interrupt:
        on_stop()
        return 128 + (interrupt.args[0] if interrupt.args else signal.SIGINT)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _do_nothing(number: int, frame: FrameType | None) -> None:
    """Answers a signal for which no other handler was set."""
