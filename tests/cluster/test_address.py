"""A scheduler and workers that somebody started by hand: `executor.address`."""

import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from cli_helpers import started, without_slow_starts
from mppi_belief.results import table as results
from slurm_helpers import STUDY, TRIALS, parts, rows, run
from study_helpers import limited, poll


@pytest.fixture(autouse=True)
def in_time() -> Iterator[None]:
    with limited(400):
        yield


@contextmanager
def dask(what: str, *args: str) -> Iterator["subprocess.Popen[bytes]"]:
    """`dask scheduler` or `dask worker`."""
    command = [sys.executable, "-m", f"distributed.cli.dask_{what}", *args, "--no-dashboard"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait(20)


@contextmanager
def scheduler(
    folder: Path, name: str, *workers: str
) -> Iterator[tuple[str, "subprocess.Popen[bytes]"]]:
    """A scheduler with a worker for each line of options: its address, its process."""
    file = folder / f"{name}.json"
    with dask("scheduler", "--host=127.0.0.1", "--port=0", f"--scheduler-file={file}") as process:
        address = poll(
            lambda: (
                file.exists() and file.stat().st_size and json.loads(file.read_text())["address"]
            )
        )
        with ExitStack() as stack:
            for options in workers:
                stack.enter_context(dask("worker", address, *options.split()))
            yield address, process


def test_a_scheduler_that_dies_ends_the_run_and_another_goes_on_with_it(tmp_path):
    def begun(address: str):
        args = ("results_dir=results", "executor=dask", f"executor.address={address}")
        return started(tmp_path, *STUDY, f"n_trials={TRIALS}", *args)

    with (
        scheduler(tmp_path, "first", *["--nthreads=1"] * 2) as (address, process),
        begun(address) as command,
    ):
        poll(lambda: parts(tmp_path), 100)
        process.kill()
        killed = time.monotonic()
        assert command.wait(60) == 75
        print(f"exit {time.monotonic() - killed:.1f} s after the scheduler died")
    (line,) = without_slow_starts((tmp_path / "stderr.txt").read_text()).splitlines()
    assert re.fullmatch(r"mppi-belief: .*scheduler is gone.*; the same command goes on", line)
    before = rows(tmp_path)
    assert 0 < len(before) < TRIALS
    with scheduler(tmp_path, "second", "--nthreads=1", "--nthreads=1") as (address, _):
        ended = run(tmp_path, "executor=dask", f"executor.address={address}")
    assert (ended.code, ended.err) == (0, "")
    here = tmp_path / "here"
    here.mkdir()
    assert run(here).code == 0
    assert results.result_hash(rows(tmp_path)) == results.result_hash(rows(here))


def test_a_worker_with_two_threads_is_refused_in_one_line(tmp_path):
    with scheduler(tmp_path, "first", "--nthreads=2") as (address, _):
        ended = run(tmp_path, "executor=dask", f"executor.address={address}")
    assert ended.code == 2
    assert re.fullmatch(
        r"mppi-belief: the worker tcp\S+ has 2 threads: start it with --nthreads 1\n", ended.err
    )
    assert not (tmp_path / "results").exists()
