"""Stops a study on signals: the first SIGINT or SIGTERM finishes what runs, the second ends it at
once.
"""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from types import FrameType

STOPPING = {signal.SIGINT, signal.SIGTERM}


class StoppedAtOnce(Exception):
    """Says that a second signal came."""


class StopRequest:
    """Says whether a signal asked to stop."""

    number: int | None = None  # the first signal
    at_once: bool = False  # whether a second signal came
    accepts_second: bool = False  # whether a second signal may raise


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
    # The first process to start would start the tracker, and that lets signals in again.
    resource_tracker.ensure_running()
    mask_before = signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask_before)


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

    handlers_before = {number: signal.signal(number, handle) for number in STOPPING}
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
