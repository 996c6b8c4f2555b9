"""Jobs of a real Slurm (`make test-cluster`): whatever happens to them, results are those of this
machine alone.
"""

import getpass
import re
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from cli_helpers import started, without_slow_starts
from mppi_belief.results import table as results
from slurm_helpers import SLURM, STUDY, TRIALS, jobs, no_jobs, parts, rows, run
from study_helpers import limited, poll

STOPPED = {signal.SIGINT: 130, signal.SIGTERM: 143}


@pytest.fixture(autouse=True)
def alone() -> Iterator[None]:
    """A test that hangs ends, and leaves no jobs."""
    with limited(400):
        yield
    subprocess.run(["scancel", f"--user={getpass.getuser()}"], check=False, timeout=60)
    no_jobs(60)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory) -> Path:
    """The study by processes on this machine."""
    folder = tmp_path_factory.mktemp("here")
    assert run(folder).code == 0
    return folder


def begun(folder: Path, *args: str):
    """The study on Slurm in the background."""
    return started(folder, *STUDY, f"n_trials={TRIALS}", "results_dir=results", *SLURM, *args)


def logged_lines(folder: Path) -> list[str]:
    return without_slow_starts((folder / "stderr.txt").read_text()).splitlines()


def same(first_folder: Path, second_folder: Path) -> bool:
    return results.result_hash(rows(first_folder)) == results.result_hash(rows(second_folder))


def test_jobs_of_slurm_compute_the_same(tmp_path, undisturbed):
    ended = run(tmp_path, *SLURM, "executor.workers_per_job=2", "workers=4")
    assert (ended.code, ended.err) == (0, "")
    assert same(tmp_path, undisturbed)
    no_jobs()


def test_a_job_that_is_cancelled_is_replaced(tmp_path, undisturbed):
    with begun(tmp_path) as process:
        poll(lambda: parts(tmp_path), 120)
        first = jobs("R")
        subprocess.run(["scancel", first[0]], check=True, timeout=30)
        poll(lambda: [job for job in jobs("R") if job not in first], 60)
        assert process.wait(200) == 0
    (line,) = logged_lines(tmp_path)
    assert re.search(r"trials? \d+.*died; running", line)
    assert same(tmp_path, undisturbed)
    no_jobs()


def test_jobs_whose_time_is_over_are_replaced(tmp_path, undisturbed):
    """A minute is the least that Slurm counts; the same numbers at a nap nine times as long."""
    with begun(tmp_path, "executor.walltime=00:01:00", "controller.nap=0.27") as process:
        first = poll(lambda: len(jobs("R")) == 2 and jobs("R"), 60)
        assert process.wait(280) == 0
    lines = logged_lines(tmp_path)
    assert lines
    assert all("died; running" in line for line in lines), lines
    assert {*rows(tmp_path)["status"]} == {"ok"}
    assert rows(tmp_path)["cost"].tolist() == rows(undisturbed)["cost"].tolist()
    assert not {*first} & {*jobs()}


@pytest.mark.parametrize("number", STOPPED, ids=lambda number: number.name)
def test_a_signal_ends_the_jobs_and_the_same_command_goes_on(number, tmp_path, undisturbed):
    with begun(tmp_path) as process:
        poll(lambda: parts(tmp_path), 120)
        process.send_signal(number)
        assert process.wait(60) == STOPPED[number]
        no_jobs(1)
    assert [line for line in logged_lines(tmp_path) if not line.startswith("stop")] == []
    assert 0 < len(rows(tmp_path)) < TRIALS
    assert run(tmp_path, *SLURM).code == 0
    assert same(tmp_path, undisturbed)


def test_jobs_whose_parent_is_killed_end_by_themselves_and_the_same_command_goes_on(
    tmp_path, undisturbed
):
    with begun(tmp_path) as process:
        poll(lambda: parts(tmp_path), 120)
        process.kill()
        process.wait(10)
    print(f"jobs ended {no_jobs(90):.1f} s after their parent was killed")
    assert run(tmp_path, *SLURM).code == 0
    assert same(tmp_path, undisturbed)


@pytest.mark.parametrize(("fate", "status"), [("kills", "crashed"), ("hangs", "timeout")])
def test_an_unlucky_trial_is_given_up_and_no_other(fate, status, tmp_path, undisturbed):
    ended = run(tmp_path, *SLURM, f"controller.fate={fate}", "trial_timeout=15")
    assert ended.code == 3
    assert "Traceback" not in ended.err
    rows_found = rows(tmp_path)
    assert rows_found[rows_found["status"] != "ok"][["trial", "status"]].to_numpy().tolist() == [
        [3, status]
    ]
    others = rows(undisturbed)
    assert (
        rows_found[rows_found["trial"] != 3]["cost"].tolist()
        == others[others["trial"] != 3]["cost"].tolist()
    )
    no_jobs()


@pytest.mark.parametrize(
    ("setting", "why"),
    [
        ("executor.partition=nowhere", "invalid partition name"),
        ("executor.memory=900TB", "not available"),
        ("executor.directives=[--nonsense]", "unrecognized option"),
        ("executor.interface=ib9", "ib9"),
    ],
)
def test_what_slurm_refuses_is_one_line(setting, why, tmp_path):
    ended = run(tmp_path, *SLURM, setting)
    assert ended.code == 2
    assert re.fullmatch(r"mppi-belief: executor.*\n", ended.err)
    assert why in ended.err.lower()
    assert not (tmp_path / "results").exists()
    assert jobs() == []


def test_jobs_that_end_before_they_work_are_not_asked_for_for_ever(tmp_path):
    ended = run(tmp_path, *SLURM, 'executor.directives=["--output=/nowhere/at/all"]')
    assert ended.code == 75
    assert re.fullmatch(
        r"mppi-belief: \d+ jobs ended before a worker connected.*; the same command goes on\n",
        ended.err,
    )
    no_jobs()


def test_a_signal_ends_the_waiting_for_jobs(tmp_path):
    with begun(tmp_path, "executor.directives=[--hold]") as process:
        poll(lambda: len(jobs("PD")) == 2, 60)
        process.send_signal(signal.SIGINT)
        assert process.wait(5) == 130
        no_jobs(1)
    assert [line for line in logged_lines(tmp_path) if not line.startswith("stop")] == []
