"""Ctrl-C, twice, and SIGTERM, whenever they come: one word, an exit code, nobody left, nothing
lost.
"""

import os
import random
import signal
import time

import pytest

from cli_helpers import python
from faults_helpers import N_TRIALS, STOPPED, STUDY, Run, begins, gone_after, send, when
from mppi_belief.results.table import result_hash
from mppi_belief.run.signals import held, polite_stop
from study_helpers import poll


def interrupt(run: Run, after: float, *numbers: signal.Signals, group: bool = True) -> int:
    """Send signals so many seconds after the command's own code has begun, 0.3 s apart; its exit
    code.

    A gate keeps the command from ending before that. As a terminal does they go to all processes of
    the group. Checks what must be true at any instant; of two that wait together, either is the
    first.
    """
    before = run.done()
    gate = run.gate(40)
    with run.begun(gate=gate) as process:
        poll(lambda: begins(process), 30)
        time.sleep(after)
        for number in numbers:
            if process.poll() is None:
                (os.killpg if group else os.kill)(process.pid, number)
                time.sleep(0.3)
        gate.open()
        code = process.wait(120)
        survivors = gone_after(process.pid)
    assert survivors == []
    assert "Traceback" not in run.err, run.err
    assert code in {STOPPED[number] for number in numbers}, run.err
    assert "the same command goes on from here" in run.err
    assert before <= run.done()
    assert run.left_over() == []
    return code


def instants(seed: int, longest: float, count: int) -> list[float]:
    """Moments of a run, its start-up included."""
    return [random.Random(f"{seed} {index}").uniform(0, longest) for index in range(count)]


@pytest.mark.long
def test_twenty_interruptions_in_a_row(tmp_path, undisturbed, seconds):
    """There is more to do than gets done by then."""
    run = Run(tmp_path, *STUDY[:-1], f"n_trials={10 * N_TRIALS}")
    for index, after in enumerate(instants(1, 0.5 * seconds, 20)):
        kinds = [
            (signal.SIGINT,),
            (signal.SIGTERM,),
            (signal.SIGINT, signal.SIGINT),
            (signal.SIGTERM, signal.SIGINT),
        ]
        interrupt(run, after, *kinds[index % 4], group=index % 8 != 1)
    assert run.again().code == 0
    assert len(run.done()) == 4 * 10 * N_TRIALS
    first = {cell: result_hash(rows[rows["trial"] < N_TRIALS]) for cell, rows in run.rows().items()}
    assert first == undisturbed.hashes


@pytest.mark.long
def test_every_tenth_of_the_start_up_can_be_interrupted(tmp_path, seconds):
    """Nothing has been computed yet when it stops."""
    for tenth in range(10):
        run = Run(tmp_path / str(tenth))
        run.folder.mkdir()
        assert interrupt(run, tenth * 0.2, signal.SIGTERM if tenth % 2 else signal.SIGINT) in (
            130,
            143,
        )


@pytest.mark.long
@pytest.mark.parametrize(
    ("numbers", "group"),
    [
        ((signal.SIGINT,), True),
        ((signal.SIGTERM,), False),
        ((signal.SIGINT, signal.SIGINT), True),
        ((signal.SIGTERM, signal.SIGINT), True),
    ],
)
def test_signals_while_it_computes_and_the_same_command_again(
    numbers, group, tmp_path, undisturbed
):
    """Once finishes the trials that run; twice loses those."""
    run = Run(tmp_path)
    gate = run.gate(60)
    with run.begun(gate=gate) as process:
        when(lambda: len(run.parts()) > 1, process)
        send(run, process, *numbers, group=group)
        gate.open()
        code = process.wait(60)
        survivors = gone_after(process.pid)
    assert (code, survivors) == (STOPPED[numbers[0]], [])
    assert "Traceback" not in run.err
    assert "the same command goes on from here" in run.err
    n_done = len(run.done())
    assert 0 < n_done < 4 * N_TRIALS
    ended = run.again()
    assert ended.code == 0
    assert f"{4 * N_TRIALS - n_done} trials run, {n_done} already done" in ended.out
    assert run.hashes() == undisturbed.hashes


def test_two_different_signals_that_have_waited_count_as_one():
    """They come in together, before anything could end at once."""
    asked: list[bool] = []
    with held():
        for number in STOPPED:
            signal.raise_signal(number)
        with polite_stop(lambda: asked.append(True)) as stop:
            assert asked == [True]
            assert not stop.at_once


def test_a_process_that_is_started_while_signals_wait_does_not_get_them(tmp_path):
    """Not even the first: Python's own helper of its processes lets signals in again when it
    starts.
    """
    script = (
        "import multiprocessing, signal\n"
        "from mppi_belief.run.signals import STOPPING, masked\n"
        "if __name__ == '__main__':\n"
        "    with masked():\n"
        "        multiprocessing.get_context('spawn').SimpleQueue()\n"
        "        print(signal.pthread_sigmask(signal.SIG_BLOCK, ()) >= STOPPING)\n"
    )
    assert python(script, tmp_path) == "True"
