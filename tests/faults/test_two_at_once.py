"""The same study started twice, and two parts of it, at the same time in the same folder: no
corruption.
"""

import signal
from contextlib import ExitStack

import pytest

from faults_helpers import N_TRIALS, Run, gone_after, when


def at_once(run: Run, *commands: str) -> list[int]:
    """Exit codes of commands that are started together."""
    with ExitStack() as stack:
        processes = [stack.enter_context(run.begun(command)) for command in commands]
        return [process.wait(300) for process in processes]


@pytest.mark.long
def test_the_same_command_twice_at_once(tmp_path, undisturbed):
    """Both end right; which of two equal files of the same trials stays does not matter."""
    run = Run(tmp_path)
    assert at_once(run, "workers=1", "workers=1") == [0, 0]
    assert "Traceback" not in run.err
    assert run.left_over() == []
    assert run.hashes() == undisturbed.hashes


@pytest.mark.long
def test_two_parts_at_once_make_the_whole(tmp_path, undisturbed):
    run = Run(tmp_path)
    assert at_once(run, "shard=1/2", "shard=2/2") == [0, 0]
    assert "Traceback" not in run.err
    assert run.hashes() == undisturbed.hashes
    assert len(run.done()) == 4 * N_TRIALS


@pytest.mark.long
def test_one_of_two_is_killed_and_the_other_ends_right(tmp_path, undisturbed):
    run = Run(tmp_path)
    victims_gate = run.gate(20)
    with (
        run.begun("workers=1", gate=victims_gate) as victim,
        run.begun("workers=1") as survivor,
    ):
        when(run.parts, victim)
        victim.send_signal(signal.SIGKILL)
        assert survivor.wait(300) == 0
        assert gone_after(victim.pid) == []
    assert run.hashes() == undisturbed.hashes
