"""Stopping politely: the first SIGINT or SIGTERM finishes what runs, the second ends it at once."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


class StoppedAtOnce(Exception):
    """A second signal came."""


class Stop:
    """Which signal asked to stop, if any did."""

    number: int | None = None


@contextmanager
def polite_stop(on_first: Callable[[], None]) -> Iterator[Stop]:
    """Call `on_first` at the first signal, raise `StoppedAtOnce` at the second; handlers are put back."""
    stop = Stop()

    def handle(number: int, frame: FrameType | None) -> None:
        if stop.number is not None:
            raise StoppedAtOnce
        stop.number = number
        on_first()

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
