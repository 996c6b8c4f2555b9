"""Workers that are killed: at start-up, while they compute, while a result is on its way.

Nothing is lost.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fault_work import HERE
from faults_helpers import Run, kill_one_that_waits, when
from study_helpers import TESTS, poll, workers_of


def kill(pid: int) -> None:
    """SIGKILL; it may have ended by itself."""
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return


def kill_a_worker_at_its_start_and_one_that_computes(run: Run, workers: int) -> tuple[int, str]:
    gate = run.gate(40)
    with run.begun(f"workers={workers}", gate=gate) as process:
        when(lambda: len(workers_of(process.pid)) == workers, process)
        kill(workers_of(process.pid)[0])
        when(run.parts, process)
        kill_one_that_waits(gate, process)
        gate.open()
        return process.wait(300), run.err


@pytest.mark.long
@pytest.mark.parametrize("workers", [1, 2])
def test_workers_that_are_killed_cost_nothing_but_time(workers, tmp_path, undisturbed):
    run = Run(tmp_path)
    code, err = kill_a_worker_at_its_start_and_one_that_computes(run, workers)
    assert code == 0, err
    assert "worker died; running" in err
    assert "Traceback" not in err
    assert run.hashes() == undisturbed.hashes


@pytest.mark.long
def test_a_worker_killed_every_second_costs_nothing_but_time(tmp_path, undisturbed):
    """As long as it gets somewhere in between: a trial is given up when its worker dies twice in it
    alone.
    """
    run = Run(tmp_path)
    gate = run.gate(0)
    with run.begun(gate=gate) as process:
        killed = 0
        while process.poll() is None and killed < 8:
            have = run.parts()
            if killed < 2:
                gate.admit(40 * (killed + 1))
            else:
                gate.open()
            poll(lambda have=have: run.parts() - have or process.poll() is not None, 120)
            for worker in workers_of(process.pid)[:1]:
                kill(worker)
                killed += 1
        code = process.wait(300)
    assert code == 0, run.err
    assert killed > 1
    assert run.hashes() == undisturbed.hashes


def test_a_worker_killed_while_its_result_is_on_its_way_costs_nothing(tmp_path):
    """The parent sleeps, so that the worker stands still halfway through a result larger than a
    pipe.
    """
    script = (
        f"import sys; sys.path[:0] = [{TESTS!r}, {HERE!r}]; "
        "import fault_work; fault_work.send_bulky_results(sys.argv[1])"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as parent:
        try:
            (begun,) = poll(lambda: list(tmp_path.iterdir()))
            os.kill(parent.pid, signal.SIGSTOP)
            (tmp_path / "go").touch()
            worker = int(begun.name)
            poll(lambda: stands_still(worker))
            kill(worker)
            os.kill(parent.pid, signal.SIGCONT)
            out, _ = parent.communicate(timeout=60)
        finally:
            parent.kill()
    assert out.splitlines() == ["its worker died; running it again", "3 results"]


def stands_still(pid: int) -> bool:
    """Returns whether a process sleeps, and computes nothing for a while."""

    def used() -> list[str]:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]

    before = used()
    time.sleep(1)
    return used() == before
