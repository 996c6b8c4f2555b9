"""Tests when times of control steps count as measured on a busy machine; no time is measured."""

import pytest

from mppi_belief.results import timing_load
from mppi_belief.results.timing_load import (
    better_timing,
    machine_load,
    measured_busy,
    to_be_measured,
)

CALM = {"seconds": [1e-3], "cpu_share": 0.99, "load": 0.9}
WAITED = {"seconds": [3e-3], "cpu_share": 0.6, "load": 0.9}
LOADED = {"seconds": [2e-3], "cpu_share": 0.99, "load": 2.5}
ON_GPU = {"seconds": [1e-3], "cpu_share": None, "load": 0.2}
UNKNOWN = {"seconds": [1e-3]}


def test_a_step_that_waited_or_a_high_load_is_busy():
    timings = (CALM, WAITED, LOADED, ON_GPU, UNKNOWN)
    assert [measured_busy(timing) for timing in timings] == [False, True, True, False, False]


@pytest.mark.parametrize(("load", "again"), [(0.3, True), (3.0, False)])
def test_times_of_a_busy_machine_are_measured_again_once_it_is_calm(load, again):
    assert to_be_measured(None, load)
    for timing in (WAITED, LOADED, UNKNOWN):
        assert to_be_measured(timing, load) == again
    for timing in (CALM, ON_GPU):
        assert not to_be_measured(timing, load)


def test_the_times_of_the_calmer_machine_stay():
    assert better_timing(None, LOADED) is LOADED
    assert better_timing(UNKNOWN, LOADED) is LOADED
    assert better_timing(WAITED, CALM) is CALM
    assert better_timing(WAITED, LOADED) is LOADED
    assert better_timing(LOADED, WAITED) is LOADED
    assert better_timing(LOADED, LOADED | {"load": 2.0})["load"] == 2.0


def test_the_load_is_that_of_a_core(monkeypatch):
    monkeypatch.setattr(timing_load.os, "getloadavg", lambda: (6.0, 1.0, 1.0), raising=False)
    monkeypatch.setattr(timing_load.os, "cpu_count", lambda: 4)
    assert machine_load() == 1.5

    def absent() -> None:
        raise OSError

    monkeypatch.setattr(timing_load.os, "getloadavg", absent, raising=False)
    assert machine_load() == 0.0
