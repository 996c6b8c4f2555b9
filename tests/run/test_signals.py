"""Handlers of signals: they wait while processes start, whichever thread the system gives the
signal to.
"""

import os
import signal
import threading
from collections.abc import Iterator

import pytest

from mppi_belief.run.signals import STOPPING, ended_by_signals, masked, polite_stop
from study_helpers import poll


@pytest.fixture
def open_thread() -> Iterator[threading.Thread]:
    """A thread that lets both signals in, as that of a progress bar does."""
    ended = threading.Event()

    def wait() -> None:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPPING)
        ended.wait()

    thread = threading.Thread(target=wait)
    thread.start()
    yield thread
    ended.set()
    thread.join()


def test_a_signal_that_another_thread_receives_waits_for_the_end_of_masked(open_thread):
    events = []

    def command() -> int:
        with masked():
            signal.pthread_kill(open_thread.ident, signal.SIGTERM)
            # Python answers between two operations of the main thread, at once or never.
            for _ in range(10_000):
                os.getpid()
            events.append("process started")
        events.append("not reached")
        return 0

    code = ended_by_signals(command, lambda: events.append("stopped"))
    assert (code, events) == (143, ["process started", "stopped"])


def test_a_second_signal_waits_too(open_thread):
    numbers = []
    with polite_stop(lambda: numbers.append("first")) as stop:
        signal.raise_signal(signal.SIGINT)
        with masked():
            signal.pthread_kill(open_thread.ident, signal.SIGINT)
            for _ in range(10_000):
                os.getpid()
            assert not stop.at_once
        pytest.fail("the second signal ends the block")
    assert (stop.number, stop.at_once, numbers) == (signal.SIGINT, True, ["first"])


def test_masked_in_another_thread_holds_back_no_handler(open_thread):
    inside = threading.Event()
    ended = threading.Event()

    def start_processes() -> None:
        with masked():
            inside.set()
            ended.wait()

    thread = threading.Thread(target=start_processes)
    thread.start()
    inside.wait()
    called = []
    with polite_stop(lambda: called.append(True)):
        signal.pthread_kill(open_thread.ident, signal.SIGTERM)
        poll(lambda: called, 10)
    ended.set()
    thread.join()
    assert called == [True]
