"""When results are written: often at first, in large files later, and at once when a run ends."""

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from mppi_belief.config.cell import Cell
from mppi_belief.results.contents import read_cell, read_rows
from mppi_belief.run import writer as ledger
from mppi_belief.run.pool import Done
from mppi_belief.run.task import Task
from mppi_belief.run.worker import Lost
from mppi_belief.run.writer import Ledger
from study_helpers import Batch, config, failed_row, row

HERE, THERE = {"host": "here", "processor": "x"}, {"host": "there", "processor": "y"}


class Clock:
    """Seconds that pass when told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(ledger, "time", made)
    return made


@pytest.fixture
def kept(tmp_path, clock) -> Ledger:
    nothing: Any = None
    task = Task(nothing, nothing, nothing, failed_row, nothing, nothing)
    return Ledger(tmp_path, task, {"commit": "a", "device": "cpu"})


def done(*trials: int, seed: int = 0, where: dict[str, str] = HERE) -> Done:
    return Done(
        Cell(config(seed=seed)), trials, Batch([row(trial) for trial in trials], [], None), where
    )


def parts(root: Path) -> list[Path]:
    return sorted(root.glob("*/part-*"))


def test_the_first_results_are_written_after_a_moment_and_later_ones_wait_longer(
    kept, clock, tmp_path
):
    waited = []
    for trial in range(4000):
        clock.now += 0.125
        kept.keep(done(trial))
        before = len(parts(tmp_path)) if trial < 200 else None
        began = kept._written
        kept.write_in_time()
        if kept._written != began:
            waited.append(clock.now - began)
        if trial == 0:
            assert parts(tmp_path) == []
        if before == 0 and trial > 0:
            assert len(parts(tmp_path)) == 1
    assert waited[0] == pytest.approx(ledger.SHORTEST, abs=0.125)
    assert all(later >= earlier - 0.125 for earlier, later in itertools.pairwise(waited))
    assert ledger.SHARE * 500 - 2 < max(waited) <= ledger.LONGEST + 0.125
    assert len(parts(tmp_path)) == len(waited) < 120
    kept.write()
    (folder,) = tmp_path.iterdir()
    assert read_rows(folder)["trial"].tolist() == list(range(4000))


def test_it_never_waits_longer_than_it_may(kept, clock, tmp_path):
    clock.now += 1e6
    kept.write_in_time()
    kept.keep(done(0))
    clock.now += ledger.LONGEST - 1
    kept.write_in_time()
    assert parts(tmp_path) == []
    clock.now += 1
    kept.write_in_time()
    assert len(parts(tmp_path)) == 1


def test_each_cell_has_its_file_and_each_place_its_source(kept, clock, tmp_path):
    for one in (done(0, 1), done(5, where=THERE), done(2), done(3, seed=1)):
        kept.keep(one)
    clock.now += 7
    kept.write()
    first, second = (tmp_path / Cell(config(seed=seed)).id for seed in (0, 1))
    (path,) = first.glob("part-*")
    sources = json.loads(pq.read_schema(path).metadata[b"mppi-belief"])["sources"]
    told = [
        (source["host"], source["trials"], source["commit"], source["elapsed"])
        for source in sources
    ]
    assert told == [("here", [[0, 2]], "a", 7.0), ("there", [[5, 5]], "a", 7.0)]
    assert read_rows(second)["trial"].tolist() == [3]
    assert sources[0]["config"] == config()


def test_lost_trials_have_their_row_and_the_first_scene_stays(kept, tmp_path):
    cell = Cell(config())
    kept.keep(Done(cell, (4,), Lost("timeout", "not done after 1 s"), {}))
    for trial, dt in ((0, 0.1), (1, 0.2)):
        steps = [
            {
                "trial": trial,
                "step": 0,
                **dict.fromkeys(("state", "mean", "cov", "control"), np.zeros(2)),
            }
        ]
        kept.keep(Done(cell, (trial,), Batch([row(trial)], steps, {"dt": dt}), HERE))
    kept.write()
    rows = read_rows(tmp_path / cell.id)
    assert rows["status"].tolist() == ["ok", "ok", "timeout"]
    assert rows["error"].tolist()[2] == "not done after 1 s"
    assert json.loads((tmp_path / cell.id / "scene.json").read_text())["dt"] == 0.1
    assert read_cell(tmp_path / cell.id).steps["trial"].tolist() == [0, 1]
    assert len([*(tmp_path / cell.id).glob("paths-*")]) == 1


def test_nothing_to_write_leaves_nothing(kept, tmp_path):
    kept.write()
    assert [*tmp_path.iterdir()] == []
