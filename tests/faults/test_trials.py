"""Trials that raise, diverge, hang or kill their worker: written down as such, and no other trial
is touched.
"""

import math
import re
from pathlib import Path

import pandas as pd
import pytest

from cli_helpers import PLANNER
from fault_work import HERE, unpicklable
from faults_helpers import Ended, Run
from mppi_belief.config.cell import Cell
from mppi_belief.report.summary import summarise_trials
from mppi_belief.results.table import read_table, result_hash
from mppi_belief.run import pool
from mppi_belief.run.local import LocalWorkers
from mppi_belief.run.plan import Chunk
from mppi_belief.run.worker import Failure, TimeLimitExceeded, WorkerSetup
from study_helpers import TESTS, AgedWorkers, answer, config

MINE = str(Path(__file__).parent / "mine")
N_TRIALS = 12
UNLUCKY = 3  # the trial that suffers its fate
DIVERGED = ("diverged", "left the finite numbers")
ENDS = {
    "becomes_nan": DIVERGED,
    "becomes_inf": DIVERGED,
    "raises": ("error", "ValueError: this trial is cursed"),
    "kills": ("crashed", "the worker process died 2 times in this trial"),
    "hangs": ("timeout", "not done after 20 s"),
}
STATUS = {fate: status for fate, (status, _) in ENDS.items()}
# A program that calls back to the host may round otherwise than one that does not, so the trials of
# a fate are compared with those of a lucky program of its own kind.
LUCKY = {fate: "nothing" if status == "diverged" else "calls" for fate, status in STATUS.items()}
FATES = (*dict.fromkeys(LUCKY.values()), *STATUS)
WITHOUT_RESULT = ("error", "crashed", "timeout")


def study(*fates: str, n_trials: int = N_TRIALS, seconds: float = 20) -> tuple[str, ...]:
    """One cell for every fate."""
    swept = f"controller.fate={','.join(fates)}"
    small = ("system=scalar_linear", *PLANNER, f"n_trials={n_trials}", f"trial_timeout={seconds}")
    return ("-m", "--config-dir", MINE, "controller=unlucky", swept, *small)


def by_fate(run: Run) -> dict[str, pd.DataFrame]:
    """The rows of each cell."""
    rows_of_fates = {}
    for cell in run.root.iterdir():
        config = read_table(next(cell.glob("part-*")))[0]["sources"][0]["config"]
        rows_of_fates[config["controller"]["fate"]] = run.rows()[cell.name]
    return rows_of_fates


@pytest.fixture(scope="module")
def night(tmp_path_factory) -> tuple[Run, Ended]:
    """All fates in one study."""
    run = Run(tmp_path_factory.mktemp("night"), *study(*FATES))
    return run, run.again()


@pytest.mark.long
@pytest.mark.parametrize("fate", STATUS)
def test_one_unlucky_trial_has_its_status_and_all_others_are_the_same_bits(night, fate):
    run, ended = night
    assert ended.code == 3
    rows = by_fate(run)[fate]
    lucky = by_fate(run)[LUCKY[fate]]
    assert rows["trial"].tolist() == list(range(N_TRIALS))
    bad = rows[rows["status"] != "ok"]
    assert list(zip(bad["trial"], bad["status"], strict=True)) == [(UNLUCKY, STATUS[fate])]
    error = bad["error"].iloc[0]
    if fate == "raises":  # the line of the user's own code is named
        assert re.search(r"ValueError: this trial is cursed \(unlucky\.py, line \d+\)$", error)
    else:
        assert error.endswith(ENDS[fate][1])
    others = rows["trial"] != UNLUCKY
    assert result_hash(rows[others]) == result_hash(lucky[others])


@pytest.mark.long
def test_every_kind_is_said_in_a_line_of_its_own(night):
    _, ended = night
    for status, count in {"diverged": 2, "error": 1, "crashed": 1, "timeout": 1}.items():
        lines = [
            line
            for line in ended.err.splitlines()
            if f": 1 {status}, e.g. trial {UNLUCKY}: " in line
        ]
        assert len(lines) == count
        assert all(len(line) < 400 for line in lines)
        replays = ["`mppi-belief replay unlucky-" in line for line in lines]
        assert replays == [status == "error"] * count


@pytest.mark.long
def test_what_has_no_result_is_counted_and_never_averaged_in(night):
    run, ended = night
    for fate, rows in by_fate(run).items():
        summary = summarise_trials(rows, None)
        good = rows[rows["status"] == "ok"]
        assert (summary.trials, summary.failed) == (N_TRIALS, int(fate in STATUS))
        assert summary.cost.value == pytest.approx(good["cost"].mean(), rel=1e-12)
        assert math.isfinite(summary.cost.value)
    assert ended.out.count(f"{N_TRIALS} (1 failed)") == len(STATUS)


@pytest.mark.long
def test_the_same_command_finds_all_done_and_retry_failed_runs_what_has_no_result(night):
    run, _ = night
    before = run.hashes()
    again = run.again()
    assert again.code == 3
    assert f"0 trials run, {len(FATES) * N_TRIALS} already done" in again.out
    retried = run.again("--retry-failed")
    count = sum(status in WITHOUT_RESULT for status in STATUS.values())
    assert f"{count} trials run, {len(FATES) * N_TRIALS - count} already done" in retried.out
    assert retried.code == 3
    assert run.hashes() == before


@pytest.mark.long
def test_a_trial_that_holds_all_threads_is_ended_from_outside(tmp_path):
    """After its time and half a minute; a chunk is one trial here.

    The control steps that are timed meet it again.
    """
    run = Run(tmp_path, *study("holds", n_trials=4))
    ended = run.again()
    assert ended.code == 3
    (rows,) = run.rows().values()
    assert rows["status"].tolist() == ["ok", "ok", "ok", "timeout"]
    assert "no timing (TimeLimitExceeded: not done after" in ended.err


def test_a_call_whose_worker_cannot_look_at_the_clock_is_ended_from_outside(tmp_path):
    """It has stopped altogether; once is enough."""
    stopped = tmp_path / "stopped"
    alone = pool.Pool(answer, AgedWorkers(stopped), print, seconds=60)
    with pytest.raises(TimeLimitExceeded):
        alone.call(answer, config(stops=1, stopped=str(stopped)), [1])
    assert alone.call(answer, config(), [1]) == [(0, 1)]
    alone.close()


def test_an_exception_that_cannot_be_unpickled_is_the_trials_own():
    """It would pass for the death of the worker: only its words come back."""
    log: list[str] = []
    running = pool.Pool(unpicklable, LocalWorkers(1, WorkerSetup([TESTS, HERE], {})), log.append)
    done = [*running.run([Chunk(Cell(config()), (0, 1, 2))])]
    running.close()
    assert [batch.outcome for batch in done] == [
        [0],
        Failure("error", "Unpicklable: two words"),
        [2],
    ]
    assert log == []
