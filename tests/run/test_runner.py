"""A study: what is done stays done, what fails is written down, and nothing starts before
everything is checked.
"""

import errno
import json
import math
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from mppi_belief.config.cell import Cell
from mppi_belief.errors import ConfigError
from mppi_belief.results import files
from mppi_belief.results import table as results
from mppi_belief.results.contents import read_rows
from mppi_belief.run import writer
from mppi_belief.run.local import LocalWorkers
from mppi_belief.run.pool import Pool
from mppi_belief.run.runner import run_study
from mppi_belief.run.signals import StoppedAtOnce, polite_stop
from mppi_belief.run.task import StudyOrder, StudyOutcome, TrialFunctions
from mppi_belief.run.worker import WorkerSetup
from mppi_belief.run.writer import ResultsWriter
from study_helpers import (
    TESTS,
    answer,
    config,
    device,
    failed_row,
    limited,
    record,
    run_trials,
    time_steps,
)


@pytest.fixture(autouse=True)
def in_time() -> Iterator[None]:
    with limited():
        yield


class Study:
    """Runs fake cells under one folder and remembers which were checked."""

    def __init__(self, root: Path, check: Callable[..., Any] = lambda config: ()) -> None:
        self.root = root
        self.checked: list[int] = []
        self.device: Callable[..., str] = device
        self.variables: dict[str, str] | None = None
        self._check = check

    def check(self, config: dict[str, Any]) -> Sequence[str]:
        self.checked.append(config["seed"])
        return self._check(config)

    def run(self, *cells: Cell, n_trials: int = 12, workers: int = 1, **order: Any) -> StudyOutcome:
        task = TrialFunctions(self.check, run_trials, time_steps, failed_row, record, self.device)
        setup = WorkerSetup([TESTS], self.variables or {})
        return run_study(
            cells,
            StudyOrder(n_trials, **order),
            self.root,
            task,
            LocalWorkers(workers, setup),
            ["mppi-belief", "run"],
        )

    def rows(self, cell: Cell) -> Any:
        return read_rows(self.root / cell.id)


@pytest.fixture
def study(tmp_path) -> Study:
    return Study(tmp_path / "results")


def test_a_study_runs_once_and_a_larger_one_only_adds(study, tmp_path):
    notes = tmp_path / "notes"
    first, second = (Cell(config(seed=seed, notes=str(notes))) for seed in (1, 2))
    outcome = study.run(first, second)
    assert outcome == StudyOutcome({first.id: 12, second.id: 12}, {first.id: 0, second.id: 0}, None)
    before = {path: path.stat().st_mtime_ns for path in study.root.rglob("*.parquet")}

    assert study.run(first, second) == StudyOutcome(
        {first.id: 0, second.id: 0}, {first.id: 12, second.id: 12}, None
    )
    assert study.run(first, n_trials=5) == StudyOutcome({first.id: 0}, {first.id: 5}, None)
    assert study.run(second, n_trials=15) == StudyOutcome({second.id: 3}, {second.id: 12}, None)
    assert study.checked == [1, 2, 2]
    assert {path: path.stat().st_mtime_ns for path in before} == before
    (new,) = set(study.root.rglob("part-*")) - set(before)
    assert results.read_table(new)[0]["sources"][0]["config"] == second.config
    assert study.rows(first)["trial"].tolist() == list(range(12))
    assert study.rows(second)["trial"].tolist() == list(range(15))
    assert notes.read_text() == "timed\n" * 2
    timing = files.read_json(study.root / first.id, "timing")
    assert timing == {"seconds": [1e-3, 2e-3, 3e-3], "cpu_share": 1.0, "load": 0.0}
    assert files.read_json(study.root / first.id, "scene") == {"dt": 0.1}


def test_two_workers_write_what_one_does(tmp_path):
    cell = Cell(config())
    first_study = Study(tmp_path / "one")
    second_study = Study(tmp_path / "two")
    first_study.run(cell, n_trials=25)
    second_study.run(cell, n_trials=25, workers=2)
    assert results.result_hash(first_study.rows(cell)) == results.result_hash(
        second_study.rows(cell)
    )


@pytest.mark.parametrize(
    ("fate", "status", "error", "trials"),
    [
        ("raises", "error", "ValueError: trial 4 is cursed", {4}),
        ("exits", "crashed", "the worker process died 2 times in this trial", {4}),
    ],
)
def test_trials_without_result_are_written_down_and_counted_as_done(
    fate, status, error, trials, study
):
    cell = Cell(config(**{fate: 4}))
    assert study.run(cell).ran == {cell.id: 12}
    rows = study.rows(cell)
    bad = rows[rows["status"] != "ok"]
    assert set(bad["trial"]) == trials
    assert set(bad["status"]) == {status}
    assert set(bad["error"]) == {error}
    assert rows["trial"].tolist() == list(range(12))
    assert study.run(cell) == StudyOutcome({cell.id: 0}, {cell.id: 12}, None)


def test_all_cells_with_missing_trials_are_checked_before_any_runs(tmp_path):
    def refuse(config: dict[str, Any]) -> Sequence[str]:
        if config["seed"] == 3:
            raise ValueError("seed 3 will not do")
        return ()

    study = Study(tmp_path / "results", refuse)
    cells = [Cell(config(seed=seed)) for seed in (1, 2, 3)]
    study.run(cells[0])
    with pytest.raises(ValueError, match="seed 3"):
        study.run(*cells)
    assert study.checked == [1, 2, 3]
    assert [path.name for path in study.root.iterdir()] == [cells[0].id]


def test_a_study_that_fails_its_check_leaves_no_folder(tmp_path):
    def refuse(config: dict[str, Any]) -> None:
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        Study(tmp_path / "a" / "results", refuse).run(Cell(config()))
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_stops_a_study_before_it_runs(tmp_path):
    (tmp_path / "file").touch()
    study = Study(tmp_path / "file")
    with pytest.raises(OSError, match=r"exists|Not a directory"):
        study.run(Cell(config()))


def test_results_say_what_computed_them_here_or_in_the_workers_environment(study):
    here = Cell(config(seed=1))
    there = Cell(config(seed=2))
    study.run(here)
    study.variables = {"DEVICE": "another"}
    study.run(there)
    devices = [
        results.read_table(next((study.root / cell.id).glob("part-*")))[0]["sources"][0][
            "device"
        ].split()
        for cell in (here, there)
    ]
    assert devices[0] == ["none", str(os.getpid())]
    assert devices[1][0] == "another"
    assert devices[1][1] != str(os.getpid())


@pytest.mark.parametrize(
    ("fate", "error", "words"),
    [
        ("raises", ValueError, "trial -1 is cursed"),
        ("exits", ConfigError, "platform=cpu: the worker process died"),
    ],
)
def test_without_its_device_nothing_is_run_or_written_and_no_worker_stays(
    fate, error, words, study
):
    study.variables = {"DEVICE": "another"}
    with pytest.raises(error, match=words):
        study.run(Cell(config(**{fate: -1})))
    assert not study.root.exists()
    assert multiprocessing.active_children() == []


def test_where_all_is_done_no_device_is_asked_for(study):
    cell = Cell(config())
    study.run(cell)
    study.device = partial(answer, trials=[-1], config=config(raises=-1))
    assert study.run(cell) == StudyOutcome({cell.id: 0}, {cell.id: 12}, None)


def test_a_disk_that_fills_up_ends_a_study_and_its_workers_and_keeps_what_was_written(
    study, monkeypatch
):
    cell = Cell(config())
    write = results.write_rows
    calls: list[Any] = []

    def write_rows(*args: Any) -> None:
        calls.append(args)
        if len(calls) > 1:
            raise OSError(errno.ENOSPC, "No space left on device")
        write(*args)

    monkeypatch.setattr(results, "write_rows", write_rows)
    monkeypatch.setattr(writer, "LONGEST_WAIT", 0.0)
    with pytest.raises(OSError, match="No space left"):
        study.run(cell, n_trials=50)
    assert multiprocessing.active_children() == []
    monkeypatch.undo()
    assert len(study.rows(cell)) == 10
    assert study.run(cell, n_trials=50) == StudyOutcome({cell.id: 40}, {cell.id: 10}, None)


def test_a_torn_file_costs_its_trials_only(study, capsys, monkeypatch):
    for wait in ("SHORTEST_WAIT", "LONGEST_WAIT"):
        monkeypatch.setattr(writer, wait, math.inf)  # one file per run, however slow it is
    cell = Cell(config())
    study.run(cell)
    study.run(cell, n_trials=22)
    first, _ = sorted((study.root / cell.id).glob("part-*"))
    first.write_bytes(first.read_bytes()[:100])
    assert study.run(cell, n_trials=22) == StudyOutcome({cell.id: 12}, {cell.id: 10}, None)
    assert first.name in capsys.readouterr().err
    assert study.rows(cell)["trial"].tolist() == list(range(22))


def test_a_broken_timing_file_is_made_again(study):
    cell = Cell(config())
    study.run(cell)
    (study.root / cell.id / "timing.json").write_text("{")
    study.run(cell)
    assert json.loads((study.root / cell.id / "timing.json").read_text())["seconds"]


@pytest.mark.parametrize(
    ("load_now", "load_after"), [(0.1, 0.0), (9.0, 4.0)], ids=["calm", "still busy"]
)
def test_times_of_a_busy_machine_are_measured_again(study, monkeypatch, load_now, load_after):
    monkeypatch.setattr("mppi_belief.run.runner.machine_load", lambda: load_now)
    cell = Cell(config())
    study.run(cell)
    files.write_json(study.root / cell.id, "timing", {"seconds": [1.0], "load": 4.0})
    study.run(cell)
    assert files.read_json(study.root / cell.id, "timing")["load"] == load_after


def test_a_recording_is_made_once_and_only_where_a_cell_asks_for_one(study):
    asking = Cell(config() | {"record": 3})
    silent = Cell(config(seed=1))
    study.run(asking, silent)
    path = study.root / asking.id / "recording-3.json"
    recording = {"trial": 3, "collided_at": None, "samples": None, "matching": {}}
    assert files.read_json(path.parent, path.stem) == recording
    path.write_text('{"trial": "mine"}')
    study.run(asking, silent, n_trials=15)
    assert path.read_text() == '{"trial": "mine"}'
    study.run(
        Cell(config() | {"record": 0})
    )  # the same cell: what is recorded does not change its trials
    assert sorted(path.name for path in study.root.rglob("recording-*")) == [
        "recording-0.json",
        "recording-3.json",
    ]
    assert not list((study.root / silent.id).glob("recording-*"))


def test_a_worker_that_dies_over_a_recording_leaves_none_and_the_rest_as_it_is(study):
    dying, living = (Cell(config(seed=seed, exits=99) | {"record": 99}) for seed in (0, 1))
    fatal = TrialFunctions(
        study.check, run_trials, time_steps, failed_row, partial(answer, trials=[99]), device
    )
    lanes = LocalWorkers(1, WorkerSetup([TESTS], {}))
    outcome = run_study([dying], StudyOrder(12), study.root, fatal, lanes, ["mppi-belief", "run"])
    assert outcome == StudyOutcome({dying.id: 12}, {dying.id: 0}, None)
    assert multiprocessing.active_children() == []
    assert study.rows(dying)["status"].tolist() == ["ok"] * 12
    assert files.read_json(study.root / dying.id, "timing") is not None
    assert (
        sorted(path.name for path in (study.root / dying.id).iterdir() if "recording" in path.name)
        == []
    )
    assert study.run(dying, living).ran == {dying.id: 0, living.id: 12}
    assert files.read_json(study.root / dying.id, "recording-99")["trial"] == 99


def test_the_first_signal_asks_the_second_ends_and_handlers_are_put_back():
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    asked = []
    with polite_stop(lambda: asked.append(True)) as stop:
        assert stop.number is None
        signal.raise_signal(signal.SIGTERM)
        assert (stop.number, asked) == (signal.SIGTERM, [True])
        with pytest.raises(StoppedAtOnce):
            signal.raise_signal(signal.SIGINT)
        assert (stop.number, asked) == (signal.SIGTERM, [True])
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


def test_a_second_signal_is_not_taken_for_an_error_of_the_call_that_it_interrupts():
    handled = []
    with polite_stop(lambda: None):
        signal.raise_signal(signal.SIGINT)
        try:
            signal.raise_signal(signal.SIGINT)
        except Exception as error:
            handled.append(error)
        handled.append("what follows the second signal")
    assert handled == []


def interrupt_at_the_first_result(monkeypatch: pytest.MonkeyPatch, times: int) -> None:
    """So many Ctrl-C arrive with the first result."""
    add = ResultsWriter.add

    def add_after_signals(self: ResultsWriter, batch: Any) -> None:
        monkeypatch.setattr(ResultsWriter, "add", add)
        for _ in range(times):
            signal.raise_signal(signal.SIGINT)
        add(self, batch)

    monkeypatch.setattr(ResultsWriter, "add", add_after_signals)


def test_one_signal_keeps_what_runs_and_the_rest_waits_for_the_next_run(study, monkeypatch):
    cell = Cell(config())
    interrupt_at_the_first_result(monkeypatch, times=1)
    outcome = study.run(cell, n_trials=50)
    trials_written = study.rows(cell)["trial"].tolist()
    assert outcome == StudyOutcome({cell.id: len(trials_written)}, {cell.id: 0}, signal.SIGINT)
    assert trials_written[:10] == list(range(10))
    assert len(trials_written) < 50
    assert files.read_json(study.root / cell.id, "timing") is None
    assert study.run(cell, n_trials=50) == StudyOutcome(
        {cell.id: 50 - len(trials_written)}, {cell.id: len(trials_written)}, None
    )


@pytest.mark.parametrize("times", [2, 3])
def test_more_signals_end_it_at_once_without_an_exception(times, study, monkeypatch):
    cell = Cell(config())
    close = Pool.close

    def interrupted_close(pool: Pool, *, kill: bool = False) -> None:
        for _ in range(times - 2):
            signal.raise_signal(signal.SIGINT)
        close(pool, kill=kill)

    interrupt_at_the_first_result(monkeypatch, times=2)
    monkeypatch.setattr(Pool, "close", interrupted_close)
    assert study.run(cell, n_trials=50).stopped == signal.SIGINT
    assert multiprocessing.active_children() == []
    assert study.rows(cell).empty
    monkeypatch.undo()
    assert study.run(cell, n_trials=50).ran == {cell.id: 50}
