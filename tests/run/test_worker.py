"""In a worker: every batch within its time, and nothing but plain data goes back."""

import os
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from mppi_belief.config.cell import batches
from mppi_belief.errors import ConfigError
from mppi_belief.results.provenance import machine
from mppi_belief.run.worker import (
    ChunkReport,
    Failure,
    TimeLimitExceeded,
    WorkerSetup,
    apply_setup,
    call_within,
    run_chunk,
)
from study_helpers import answer, config


def sleeps_at(config: dict[str, Any], trials: tuple[int, ...]) -> list[int]:
    if config["system"]["hangs"] in trials:
        time.sleep(3600)
    return list(trials)


def test_what_is_done_in_time_is_returned_or_raised():
    for seconds in (None, 60.0, 1e9, 1e300):
        assert call_within(seconds, divmod, 7, 2) == (3, 1)
        with pytest.raises(ZeroDivisionError):
            call_within(seconds, divmod, 7, 0)


def test_a_time_limit_needs_a_thread_and_no_limit_does_not():
    assert call_within(None, threading.current_thread) is threading.current_thread()
    assert call_within(60.0, threading.current_thread) is not threading.current_thread()


def test_what_takes_too_long_is_left_behind():
    release = threading.Event()
    with pytest.raises(TimeLimitExceeded, match=r"not done after 0\.05 s"):
        call_within(0.05, release.wait)
    release.set()


@pytest.mark.parametrize(
    ("batch", "stuck", "done", "not_begun"),
    [(1, (2,), [(0,), (1,)], (3, 4)), (3, (0, 1, 2), [], (3, 4))],
)
def test_a_trial_that_hangs_costs_its_batch_and_those_after_it_are_left_to_another(
    batch, stuck, done, not_begun
):
    report = run_chunk(sleeps_at, {"system": {"hangs": 2}}, list(batches(range(5), batch)), 2.0)
    assert report.outcomes[:-1] == [(trials, list(trials)) for trials in done]
    assert report.outcomes[-1] == (stuck, Failure("timeout", "not done after 2 s"))
    assert (report.unfinished, report.mistake) == (not_begun, None)


def test_an_exception_is_text_and_the_rest_is_run():
    report = run_chunk(answer, config(raises=1), [(0,), (1,), (2,)], 60.0)
    lost = Failure("error", "ValueError: trial 1 is cursed")
    assert report == ChunkReport(
        [((0,), [(0, 0)]), ((1,), lost), ((2,), [(0, 2)])], machine(), report.seconds
    )
    assert 0 < report.seconds < 60


def test_a_mistake_ends_the_chunk_and_keeps_what_is_done():
    report = run_chunk(answer, config(misses_its_device=1), [(0,), (1,), (2,)], None)
    assert report.outcomes == [((0,), [(0, 0)])]
    assert report.mistake == "platform=gpu: none is there any more"
    with pytest.raises(ConfigError):
        answer(config(misses_its_device=1), [1])


def test_it_takes_over_paths_and_variables(monkeypatch):
    monkeypatch.setattr("sys.path", ["old"])
    monkeypatch.setenv("KEPT", "1")
    monkeypatch.setenv("CHANGED", "1")
    monkeypatch.setenv("JAX_RANDOM_SEED_OFFSET", "5")
    apply_setup(WorkerSetup(["new"], {"CHANGED": "2"}))
    import sys

    assert sys.path == [str(Path("new").resolve()), "old"]
    assert (os.environ["KEPT"], os.environ["CHANGED"]) == ("1", "2")
    assert "JAX_RANDOM_SEED_OFFSET" not in os.environ


def test_it_says_where_it_is():
    assert set(machine()) == {"host", "platform", "processor", "settings"}
    assert all(machine()[name] for name in ("host", "platform", "processor"))
