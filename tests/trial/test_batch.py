"""Trials that advance together as one program have the rows of those that run alone, wherever they run."""

import multiprocessing
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli_helpers import SMALL, compose
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
from mppi_belief.run.writer import Ledger
from mppi_belief.trial import check, device, failed_row, record, run_trials, trials
from study_helpers import TESTS, limited, time_steps

TRIALS = 8  # a whole study
NUMBERS = ("cost", "running_cost", "terminal_cost", "final_distance", "ess")


@pytest.fixture(autouse=True, scope="module")
def quick() -> Iterator[None]:
    with compiled_quickly():
        yield


def numbers(batch: Any) -> np.ndarray:
    """The rows' numbers (trials, NUMBERS), and 0 where a controller has none."""
    return np.nan_to_num(np.array([[row[name] for name in NUMBERS] for row in batch.rows]))


@pytest.mark.parametrize(
    ("controller", "precision"),
    [(name, "float64") for name in ("belief", "ce", "ilqg", "pipf")]
    + [(name, "float32") for name in ("belief", "ilqg")],
)
def test_a_study_as_one_program_agrees_with_its_trials_one_by_one(controller, precision):
    """Each rounding on the way changes a row as a prior mean moved by as much does, at most; how much that is, is tried
    with a move far above rounding. Some 10 roundings follow each other at a step of a path, one at each sample."""
    config = compose(*SMALL, f"controller={controller}", f"precision={precision}")
    together = config | {"batch": TRIALS}
    assert [chunk.trials for chunk in chunks(Cell(together), TRIALS, (), 1)] == [
        tuple(range(TRIALS))
    ]
    alone, batch = run_trials(config, range(TRIALS)), run_trials(together, range(TRIALS))

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
    """A study in batches of five."""
    return compose(*SMALL, "controller=ce", "batch=5")


@pytest.fixture
def calls(monkeypatch) -> list[list[int]]:
    """The trials at the places of every batch that runs; trial 6 raises whatever batch it is in."""
    run, seen = trials.simulate_and_judge, []

    def cursed(*args: Any) -> Any:
        seen.append(args[-1].tolist())
        if 6 in seen[-1]:
            raise ValueError("trial 6 is cursed")
        return run(*args)

    monkeypatch.setattr(trials, "simulate_and_judge", cursed)
    return seen


def same_bits(one: Any, other: Any) -> None:
    """Equal rows and paths, numbers that are not there included."""
    assert [list(row) for row in one.rows] == [list(row) for row in other.rows]
    assert repr(one.rows) == repr(other.rows)
    for step, again in zip(one.paths, other.paths, strict=True):
        for name, value in step.items():
            np.testing.assert_array_equal(again[name], value)


def test_a_trial_has_the_same_bits_whichever_of_its_batch_are_missing(five):
    whole = run_trials(five, range(12))
    compiled = trials.simulate_and_judge._cache_size()
    for some in ([0, 1, 2], [7], [4, 5, 11]):
        part = run_trials(five, some)
        kept = [row for row in whole.rows if row["trial"] in some]
        steps = [step for step in whole.paths if step["trial"] in some]
        same_bits(part, whole._replace(rows=kept, paths=steps))
    assert trials.simulate_and_judge._cache_size() == compiled


def test_all_batches_have_one_size_and_no_place_a_trial_that_is_not_wanted(five, calls):
    run_trials(five, [1, 2, 8, 10, 11])
    assert calls == [[1, 1, 2, 1, 1], [8, 8, 8, 8, 8], [10, 11, 10, 10, 10]]


def test_a_trial_that_raises_costs_its_own_row_and_no_other(five, calls):
    rows = run_trials(five, range(10)).rows
    assert [row["status"] for row in rows] == ["ok"] * 6 + ["error"] + ["ok"] * 3
    assert rows[6]["error"] == "ValueError: trial 6 is cursed"
    assert len(calls) <= 2 + 2 * 3  # two batches; each halving of five runs two
    calls.clear()
    assert repr(rows[:6] + rows[7:]) == repr(run_trials(five, [0, 1, 2, 3, 4, 5, 7, 8, 9]).rows)
    assert len(calls) == 2


def test_a_batch_too_large_for_the_device_is_told_and_is_no_trials_fault(five, monkeypatch):
    def exhausted(*args: Any) -> Any:
        raise RuntimeError("RESOURCE_EXHAUSTED: Out of memory while trying to allocate 99 bytes.")

    monkeypatch.setattr(trials, "simulate_and_judge", exhausted)
    with pytest.raises(ConfigError, match="batch=5: too many trials for the memory"):
        run_trials(five, range(10))


class Study:
    """Trials in batches of five, in a pool whose workers compile quickly and what is new to them all."""

    def __init__(self, root: Path, config: dict[str, Any]) -> None:
        self.root, self.cell = root, Cell(config)
        cache = {
            "JAX_COMPILATION_CACHE_DIR": str(root.parent / "xla"),
            "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        }
        self.variables = {"JAX_PLATFORMS": "cpu", "JAX_DISABLE_MOST_OPTIMIZATIONS": "1", **cache}

    def run(self, n_trials: int, workers: int) -> int | None:
        task, command = (
            TrialFunctions(check, run_trials, time_steps, failed_row, record, device),
            ["mppi-belief", "run"],
        )
        lanes = LocalWorkers(workers, WorkerSetup([TESTS], self.variables))
        return run_study([self.cell], StudyOrder(n_trials), self.root, task, lanes, command).stopped

    def rows(self) -> Any:
        return read_rows(self.root / self.cell.id)


def interrupt_at_the_first_result(monkeypatch: pytest.MonkeyPatch) -> None:
    def keep(self: Ledger, done: Any) -> None:
        for _ in range(2):  # at once: nothing of this chunk and of those that run is kept
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Ledger, "keep", keep)


def test_interrupted_and_resumed_with_other_workers_the_bits_are_the_same(
    five, tmp_path, monkeypatch
):
    with limited():
        at_once, bit_by_bit = Study(tmp_path / "one", five), Study(tmp_path / "other", five)
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
