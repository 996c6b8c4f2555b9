"""The same promises where Dask brings the work to its workers, here to two of its own on this
machine.
"""

import signal

import pytest

from faults_helpers import STOPPED, Run, gone_after, kill_one_that_waits, send, when
from test_trials import N_TRIALS, STATUS, UNLUCKY, by_fate, study

DASK = ("executor=dask", "workers=2")
pytestmark = pytest.mark.long


def test_a_worker_that_is_killed_costs_nothing_but_time(tmp_path, undisturbed):
    run = Run(tmp_path)
    gate = run.gate(40)
    with run.begun(*DASK, gate=gate) as process:
        when(run.parts, process)
        kill_one_that_waits(gate, process)
        gate.open()
        assert process.wait(300) == 0, run.err
    assert "worker died; running" in run.err
    assert "Traceback" not in run.err
    assert run.hashes() == undisturbed.hashes


def test_no_worker_outlives_its_parent_and_the_same_command_goes_on(tmp_path, undisturbed):
    run = Run(tmp_path)
    with run.begun(*DASK, gate=run.gate(40)) as process:
        when(run.parts, process)
        process.kill()
        process.wait(10)
        assert gone_after(process.pid) == []
    assert run.again().code == 0
    assert run.hashes() == undisturbed.hashes


@pytest.mark.parametrize(
    "numbers", [(signal.SIGINT,), (signal.SIGTERM,), (signal.SIGINT, signal.SIGINT)]
)
def test_signals_and_the_same_command_again(numbers, tmp_path, undisturbed):
    run = Run(tmp_path)
    gate = run.gate(40)
    with run.begun(*DASK, gate=gate) as process:
        when(run.parts, process)
        send(run, process, *numbers)
        gate.open()
        code = process.wait(60)
        survivors = gone_after(process.pid)
    assert (code, survivors) == (STOPPED[numbers[0]], []), run.err
    assert "Traceback" not in run.err
    assert run.left_over() == []
    assert run.again(*DASK).code == 0
    assert run.hashes() == undisturbed.hashes


def test_trials_that_hang_or_kill_their_worker_have_their_status(tmp_path):
    run = Run(tmp_path, *study("kills", "hangs"))
    ended = run.again(*DASK)
    assert ended.code == 3, ended.err
    for fate, rows in by_fate(run).items():
        assert rows["status"].tolist() == [
            STATUS[fate] if trial == UNLUCKY else "ok" for trial in range(N_TRIALS)
        ]
