"""Tests that a log says what has had no result for some seconds."""

import threading

import pytest

from mppi_belief.run import slow_starts
from mppi_belief.run.slow_starts import SlowStarts, announced


@pytest.fixture
def clock(monkeypatch) -> list[float]:
    """Returns the time of a clock, in a list to be changed."""
    times = [100.0]
    monkeypatch.setattr(slow_starts.time, "monotonic", lambda: times[0])
    monkeypatch.setattr(slow_starts, "PATIENCE", 5.0)
    return times


def test_a_job_without_a_result_has_one_line(clock, capsys):
    jobs = SlowStarts()
    jobs.running("belief-1")
    jobs.running("ce-2")
    clock[0] += 4.9
    jobs.running("belief-1")
    jobs.ended("ce-2")
    assert capsys.readouterr().err == ""
    clock[0] += 0.2
    for _ in range(3):
        jobs.running("belief-1")
        jobs.running("ce-2")
    assert capsys.readouterr().err == "belief-1: compiling or computing its first result\n"


def test_a_slow_block_is_announced_while_it_runs(monkeypatch, capsys):
    monkeypatch.setattr(slow_starts, "PATIENCE", 0.0)
    written = threading.Event()
    log = slow_starts.log_off_terminal

    def write(line: str) -> None:
        log(line)
        written.set()

    monkeypatch.setattr(slow_starts, "log_off_terminal", write)
    with announced("compiling"):
        assert written.wait(60)
    assert capsys.readouterr().err == "compiling\n"


def test_a_quick_block_is_not_announced(monkeypatch, capsys):
    with announced("compiling"):
        pass
    assert capsys.readouterr().err == ""


def test_a_terminal_has_no_such_line(monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    slow_starts.log_off_terminal("compiling")
    assert capsys.readouterr().err == ""
