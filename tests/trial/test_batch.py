"""Tests that trials of a batch, one program, have the rows of trials that run alone."""

import multiprocessing
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli_helpers import SMALL, compose
from compilation_helpers import COMPILED, collect_events
from experiment_helpers import compiled_quickly
from mppi_belief.config.cell import Cell
from mppi_belief.errors import ConfigError
from mppi_belief.results import table as results
from mppi_belief.results.contents import read_rows
from mppi_belief.run.local import LocalWorkers
from mppi_belief.run.plan import chunks
from mppi_belief.run.runner import run_study
from mppi_belief.run.task import StudyOrder, TrialFunctions
from mppi_belief.run.worker import WorkerSetup
from mppi_belief.run.writer import ResultsWriter
from mppi_belief.trial import check, device, failed_row, record, run_trials, trials
from study_helpers import TESTS, limited, time_steps

TRIALS = 8  # a whole study
NUMBERS = ("cost", "running_cost", "terminal_cost", "final_distance", "ess")


@pytest.fixture(autouse=True, scope="module")
def quick() -> Iterator[None]:
    with compiled_quickly():
        yield


def numbers(batch: Any) -> np.ndarray:
    """Returns the rows' numbers (trials, NUMBERS), and 0 where a controller has none."""
    return np.nan_to_num(np.array([[row[name] for name in NUMBERS] for row in batch.rows]))


@pytest.mark.parametrize(
    ("controller", "precision"),
    [(name, "float64") for name in ("belief", "ce", "ilqg", "pipf")]
    + [(name, "float32") for name in ("belief", "ilqg")],
)
def test_a_study_as_one_program_agrees_with_its_trials_one_by_one(controller, precision):
    """Bounds the differences by the number of roundings times the effect of one.

    A rounding changes a row at most as much as an equal move of the prior mean does. That effect is
    measured with a move far above rounding. Some 10 roundings follow each other at a step of a
    path, and one at each sample.
    """
    config = compose(*SMALL, f"controller={controller}", f"precision={precision}")
    together = config | {"batch": TRIALS}
    assert [chunk.trials for chunk in chunks(Cell(together), TRIALS, (), 1)] == [
        tuple(range(TRIALS))
    ]
    alone = run_trials(config, range(TRIALS))
    batch = run_trials(together, range(TRIALS))

    eps = float(np.finfo(precision).eps)
    move = eps**0.5
    moved = config["problem"] | {
        "prior_mean": [mean + move for mean in config["problem"]["prior_mean"]]
    }
    effect = (
        np.abs(
            numbers(run_trials(config | {"problem": moved}, range(TRIALS))) - numbers(alone)
        ).max()
        / move
    )
    planner = config["planner"]
    roundings = config["problem"]["steps"] * (10 * planner["horizon"] + planner["n_samples"])
    assert np.abs(numbers(batch) - numbers(alone)).max() <= roundings * effect * eps
    assert [row["trial"] for row in batch.rows] == list(range(TRIALS))
    for column in ("state", "mean", "cov", "control"):
        assert [step[column].shape for step in batch.paths] == [
            step[column].shape for step in alone.paths
        ]


@pytest.fixture(scope="module")
def five() -> dict[str, Any]:
    """Returns the configuration of a study in batches of five."""
    return compose(*SMALL, "controller=ce", "batch=5")


@pytest.fixture
def calls(monkeypatch) -> list[list[int]]:
    """Collects the trials at the positions of every batch; trial 6 raises in any batch."""
    run = trials.simulate_and_judge
    batches = []

    def cursed(*args: Any) -> Any:
        batches.append(args[-1].tolist())
        if 6 in batches[-1]:
            raise ValueError("trial 6 is cursed")
        return run(*args)

    monkeypatch.setattr(trials, "simulate_and_judge", cursed)
    return batches


def assert_same_bits(first: Any, second: Any) -> None:
    """Asserts that rows and paths are equal, absent numbers included."""
    assert [list(row) for row in first.rows] == [list(row) for row in second.rows]
    assert repr(first.rows) == repr(second.rows)
    for step, again in zip(first.paths, second.paths, strict=True):
        for name, value in step.items():
            np.testing.assert_array_equal(again[name], value)


def test_a_trial_has_the_same_bits_whichever_of_its_batch_are_missing(five):
    complete = run_trials(five, range(12))
    with collect_events(COMPILED) as compiled:
        for selected in ([0, 1, 2], [7], [4, 5, 11]):
            part = run_trials(five, selected)
            rows = [row for row in complete.rows if row["trial"] in selected]
            steps = [step for step in complete.paths if step["trial"] in selected]
            assert_same_bits(part, complete._replace(rows=rows, paths=steps))
    assert compiled == []


def test_all_batches_have_one_size_and_only_trials_that_are_wanted(five, calls):
    run_trials(five, [1, 2, 8, 10, 11])
    assert calls == [[1, 1, 2, 1, 1], [8, 8, 8, 8, 8], [10, 11, 10, 10, 10]]


def test_a_trial_that_raises_costs_its_own_row_and_no_other(five, calls):
    rows = run_trials(five, range(10)).rows
    assert [row["status"] for row in rows] == ["ok"] * 6 + ["error"] + ["ok"] * 3
    assert rows[6]["error"].startswith("ValueError: trial 6 is cursed (trial/test_batch.py, line ")
    assert len(calls) <= 2 + 2 * 3  # two batches; each halving of five runs two
    calls.clear()
    assert repr(rows[:6] + rows[7:]) == repr(run_trials(five, [0, 1, 2, 3, 4, 5, 7, 8, 9]).rows)
    assert len(calls) == 2


def test_a_batch_too_large_for_the_device_is_reported_as_such(five, monkeypatch):
    def exhausted(*args: Any) -> Any:
        raise RuntimeError("RESOURCE_EXHAUSTED: Out of memory while trying to allocate 99 bytes.")

    monkeypatch.setattr(trials, "simulate_and_judge", exhausted)
    with pytest.raises(ConfigError, match="batch=5: too many trials for the memory"):
        run_trials(five, range(10))


class Study:
    """Runs trials in batches of five, in a pool whose workers compile quickly and share a cache."""

    def __init__(self, root: Path, config: dict[str, Any]) -> None:
        self.root = root
        self.cell = Cell(config)
        cache = {
            "JAX_COMPILATION_CACHE_DIR": str(root.parent / "xla"),
            "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        }
        self.variables = {"JAX_PLATFORMS": "cpu", "JAX_DISABLE_MOST_OPTIMIZATIONS": "1", **cache}

    def run(self, n_trials: int, workers: int) -> int | None:
        functions = TrialFunctions(check, run_trials, time_steps, failed_row, record, device)
        local = LocalWorkers(workers, WorkerSetup([TESTS], self.variables))
        command = ["mppi-belief", "run"]
        outcome = run_study([self.cell], StudyOrder(n_trials), self.root, functions, local, command)
        return outcome.stopped

    def rows(self) -> Any:
        return read_rows(self.root / self.cell.id)


def interrupt_at_the_first_result(monkeypatch: pytest.MonkeyPatch) -> None:
    def add(self: ResultsWriter, batch: Any) -> None:
        for _ in range(2):  # stops at once: nothing of this batch and of those that run is kept
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(ResultsWriter, "add", add)


def test_interrupted_and_resumed_with_other_workers_the_bits_are_the_same(
    five, tmp_path, monkeypatch
):
    with limited():
        at_once = Study(tmp_path / "at_once", five)
        bit_by_bit = Study(tmp_path / "bit_by_bit", five)
        assert at_once.run(12, workers=1) is None
        assert bit_by_bit.run(7, workers=2) is None  # leaves the second batch begun
        with monkeypatch.context() as patch:
            interrupt_at_the_first_result(patch)
            assert bit_by_bit.run(12, workers=2) == signal.SIGINT
        assert len(bit_by_bit.rows()) == 7
        assert bit_by_bit.run(12, workers=1) is None
    assert bit_by_bit.rows()["trial"].tolist() == list(range(12))
    assert set(bit_by_bit.rows()["status"]) == {"ok"}
    assert results.result_hash(at_once.rows()) == results.result_hash(bit_by_bit.rows())
    assert multiprocessing.active_children() == []
