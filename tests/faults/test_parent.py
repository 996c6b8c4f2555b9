"""The process that leads a study is killed, at any instant: its workers follow, the same command
goes on.
"""

import os
import random
import signal
import time

import pytest

from faults_helpers import N_TRIALS, Run, begins, gone_after, when
from study_helpers import poll, workers_of


def test_no_worker_outlives_its_parent_and_the_same_command_goes_on(tmp_path, undisturbed):
    """A worker is killed before, while it starts."""
    run = Run(tmp_path)
    with run.begun(gate=run.gate(60)) as process:
        when(lambda: len(workers_of(process.pid)) == 2, process)
        os.kill(workers_of(process.pid)[0], signal.SIGKILL)
        when(lambda: len(run.parts()) > 1, process)
        assert "worker died; running" in run.err
        assert len(workers_of(process.pid)) == 2
        process.kill()
        process.wait(10)
        assert gone_after(process.pid) == []
    n_done = len(run.done())
    assert 0 < n_done < 4 * N_TRIALS
    ended = run.again()
    assert (ended.code, ended.err) == (0, "")
    assert f"{4 * N_TRIALS - n_done} trials run, {n_done} already done" in ended.out
    assert run.hashes() == undisturbed.hashes


@pytest.mark.long
def test_killed_ten_times_at_random_instants(tmp_path, undisturbed, seconds):
    """Workers that have just been started notice as well; a file is whole or not there."""
    run = Run(tmp_path)
    for seed in range(10):
        before = run.done()
        with run.begun() as process:
            poll(lambda process=process: begins(process), 30)
            time.sleep(random.Random(seed).uniform(0, seconds))
            process.kill()
            assert process.wait(10) in (0, -signal.SIGKILL)
            assert gone_after(process.pid) == []
        assert before <= run.done()
    assert run.again().code == 0
    assert run.hashes() == undisturbed.hashes
