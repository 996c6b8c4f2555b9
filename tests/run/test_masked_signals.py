"""Handlers of signals: they wait while processes start, whichever thread the system gives the
signal to.
"""

import os
import signal
import threading
from collections.abc import Callable, Iterator

import pytest

from mppi_belief.run.signals import STOPPING, ended_by_signals, masked, polite_stop


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


@pytest.fixture
def send(open_thread) -> Iterator[Callable[[int], None]]:
    """Sends a signal to that thread, and returns when it has been received."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    before = signal.set_wakeup_fd(writer)

    def send_and_wait(number: int) -> None:
        signal.pthread_kill(open_thread.ident, number)
        assert os.read(reader, 1) == bytes([number])

    yield send_and_wait
    signal.set_wakeup_fd(before)
    os.close(reader)
    os.close(writer)


def test_a_signal_that_another_thread_receives_waits_for_the_end_of_masked(send):
    events = []

    def command() -> int:
        with masked():
            send(signal.SIGTERM)
            events.append("process started")
        events.append("not reached")
        return 0

    code = ended_by_signals(command, lambda: events.append("stopped"))
    assert (code, events) == (143, ["process started", "stopped"])


def test_a_second_signal_waits_too(send):
    numbers = []
    with polite_stop(lambda: numbers.append("first")) as stop:
        send(signal.SIGINT)
        with masked():
            send(signal.SIGINT)
            assert not stop.at_once
        pytest.fail("the second signal ends the block")
    assert (stop.number, stop.at_once, numbers) == (signal.SIGINT, True, ["first"])


def test_masked_in_another_thread_holds_back_no_handler(send):
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
        send(signal.SIGTERM)
    ended.set()
    thread.join()
    assert called == [True]
