"""When results are written: often at first, in large files later, and at once when a run ends."""

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from mppi_belief.config.cell import Cell
from mppi_belief.results import table as results
from mppi_belief.results.contents import read_cell, read_rows
from mppi_belief.run import writer as writing
from mppi_belief.run.pool import CompletedBatch
from mppi_belief.run.task import TrialFunctions
from mppi_belief.run.worker import Failure
from mppi_belief.run.writer import ResultsWriter
from study_helpers import Batch, config, failed_row, row

HERE = {"host": "here", "processor": "x"}
THERE = {"host": "there", "processor": "y"}


class Clock:
    """Seconds that pass when told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch) -> Clock:
    fake_clock = Clock()
    monkeypatch.setattr(writing, "time", fake_clock)
    return fake_clock


@pytest.fixture
def writer(tmp_path, clock) -> ResultsWriter:
    unused: Any = None
    task = TrialFunctions(unused, unused, unused, failed_row, unused, unused)
    return ResultsWriter(tmp_path, task, {"commit": "a", "device": "cpu"})


def done(*trials: int, seed: int = 0, where: dict[str, str] = HERE) -> CompletedBatch:
    return CompletedBatch(
        Cell(config(seed=seed)), trials, Batch([row(trial) for trial in trials], [], None), where
    )


def parts(root: Path) -> list[Path]:
    return sorted(root.glob("*/part-*"))


def test_the_first_results_are_written_after_a_moment_and_later_ones_wait_longer(
    writer, clock, tmp_path, monkeypatch
):
    written: list[float] = []
    write_rows = results.write_rows

    def timed_write(*args: Any) -> None:
        written.append(clock.now)
        write_rows(*args)

    monkeypatch.setattr(results, "write_rows", timed_write)
    start_time = clock.now
    for trial in range(4000):
        clock.now += 0.125
        writer.add(done(trial))
        writer.write_when_due()
        if trial == 0:
            assert parts(tmp_path) == []
    waits = [later - earlier for earlier, later in itertools.pairwise([start_time, *written])]
    assert waits[0] == pytest.approx(writing.SHORTEST_WAIT, abs=0.125)
    assert all(later >= earlier - 0.125 for earlier, later in itertools.pairwise(waits))
    assert writing.WAITING_SHARE * 500 - 2 < max(waits) <= writing.LONGEST_WAIT + 0.125
    assert len(parts(tmp_path)) == len(waits) < 120
    writer.write()
    (folder,) = tmp_path.iterdir()
    assert read_rows(folder)["trial"].tolist() == list(range(4000))


def test_it_never_waits_longer_than_it_may(writer, clock, tmp_path):
    clock.now += 1e6
    writer.write_when_due()
    writer.add(done(0))
    clock.now += writing.LONGEST_WAIT - 1
    writer.write_when_due()
    assert parts(tmp_path) == []
    clock.now += 1
    writer.write_when_due()
    assert len(parts(tmp_path)) == 1


def test_each_cell_has_its_file_and_each_place_its_source(writer, clock, tmp_path):
    for batch in (done(0, 1), done(5, where=THERE), done(2), done(3, seed=1)):
        writer.add(batch)
    clock.now += 7
    writer.write()
    first, second = (tmp_path / Cell(config(seed=seed)).id for seed in (0, 1))
    (path,) = first.glob("part-*")
    sources = json.loads(pq.read_schema(path).metadata[b"mppi-belief"])["sources"]
    facts = [
        (source["host"], source["trials"], source["commit"], source["elapsed"])
        for source in sources
    ]
    assert facts == [("here", [[0, 2]], "a", 7.0), ("there", [[5, 5]], "a", 7.0)]
    assert read_rows(second)["trial"].tolist() == [3]
    assert sources[0]["config"] == config()


def test_lost_trials_have_their_row_and_the_first_scene_stays(writer, tmp_path):
    cell = Cell(config())
    writer.add(CompletedBatch(cell, (4,), Failure("timeout", "not done after 1 s"), {}))
    for trial, dt in ((0, 0.1), (1, 0.2)):
        steps = [
            {
                "trial": trial,
                "step": 0,
                **dict.fromkeys(("state", "mean", "cov", "control"), np.zeros(2)),
            }
        ]
        writer.add(CompletedBatch(cell, (trial,), Batch([row(trial)], steps, {"dt": dt}), HERE))
    writer.write()
    rows = read_rows(tmp_path / cell.id)
    assert rows["status"].tolist() == ["ok", "ok", "timeout"]
    assert rows["error"].tolist()[2] == "not done after 1 s"
    assert json.loads((tmp_path / cell.id / "scene.json").read_text())["dt"] == 0.1
    assert read_cell(tmp_path / cell.id).steps["trial"].tolist() == [0, 1]
    assert len([*(tmp_path / cell.id).glob("paths-*")]) == 1


def test_nothing_to_write_leaves_nothing(writer, tmp_path):
    writer.write()
    assert [*tmp_path.iterdir()] == []
