"""Stopping politely: the first SIGINT or SIGTERM finishes what runs, the second ends it at once."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from types import FrameType

STOPPING = {signal.SIGINT, signal.SIGTERM}


class StoppedAtOnce(Exception):
    """A second signal came."""


class Stop:
    """Which signal asked to stop, if any did, and whether a second one did."""

    number: int | None = None
    at_once: bool = False
    open: bool = False  # whether a second one is let in


@contextmanager
def held() -> Iterator[None]:
    """Keep signals waiting: a half-done import answers them with a traceback. `polite_stop` lets them in."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)
    try:
        yield
    finally:
        for number in signal.sigpending() & STOPPING:
            signal.sigwait({number})
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def masked() -> Iterator[None]:
    """Signals wait meanwhile; threads and processes that are started here never get them from a terminal."""
    resource_tracker.ensure_running()  # the first process to start would start it, and it lets signals in again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def polite_stop(on_first: Callable[[], None]) -> Iterator[Stop]:
    """Call `on_first` at the first signal, raise `StoppedAtOnce` at the second, which ends no more than the block; what
    was before is put back."""
    stop = Stop()

    def handle(number: int, frame: FrameType | None) -> None:
        if stop.number is None:
            stop.number = number
            on_first()
        elif stop.open and not stop.at_once:
            stop.at_once = True
            raise StoppedAtOnce

    handlers = {number: signal.signal(number, handle) for number in STOPPING}
    # two that have waited count as one, and one that comes when all is over as none
    mask = signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPPING)
    try:
        stop.open = True
        yield stop
    except StoppedAtOnce:
        pass
    finally:
        stop.open = False
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for number, handler in handlers.items():
            signal.signal(number, handler)
