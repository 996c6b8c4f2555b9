"""What a run says while it runs: a line for every event on stderr, a bar on a terminal only, the
table on stdout.
"""

import os
import pty
import re
import signal
import subprocess
import termios

import pytest

from cli_helpers import COMMAND
from faults_helpers import Run, kill_one_that_waits, when
from gate_helpers import EVERYTHING
from study_helpers import poll

BAR = re.compile(r"^\s*\d+%\|.*\| \d+/\d+ \[.*\]$")


def on_a_terminal(
    run: Run, *numbers: signal.Signals, kill_a_worker: bool = False
) -> tuple[int, str]:
    """Exit code, and what a terminal of 100 columns gets on stderr."""
    ours, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (40, 100))
    output = bytearray()
    gate = run.gate(90 if numbers or kill_a_worker else EVERYTHING)
    with subprocess.Popen(
        [COMMAND, "run", *run.study],
        cwd=run.folder,
        env=gate.environment,
        stdout=subprocess.DEVNULL,
        stderr=theirs,
        start_new_session=True,
    ) as process:
        os.close(theirs)
        try:
            done = []

            def read() -> bool:
                try:
                    os.set_blocking(ours, False)
                    output.extend(os.read(ours, 1 << 16))
                except BlockingIOError:
                    pass
                except OSError:  # the other end is closed
                    done.append(True)
                return bool(done)

            if kill_a_worker:
                poll(lambda: read() or (run.parts() and gate.waiting()))
                os.kill(gate.waiting()[0], signal.SIGKILL)
            poll(lambda: read() or len(run.parts()) > 2)
            for number in numbers:
                process.send_signal(number)
                poll(lambda: read() or b"stopping" in output)
            gate.open()
            poll(read, 300)
            code = process.wait(60)
        finally:
            process.kill()
            os.close(ours)
    return code, output.decode()


@pytest.mark.long
def test_events_stand_on_lines_of_their_own_above_the_bar(tmp_path):
    """A worker that dies, a Ctrl-C, then a resume."""
    run = Run(tmp_path)
    code, output = on_a_terminal(run, signal.SIGINT, kill_a_worker=True)
    assert code == 130
    lines = shown(output)
    events = [line for line in lines if line and not BAR.match(line)]
    assert any("worker died; running" in line for line in events), lines
    assert "stopping: finishing the trials that run; once more to stop at once" in events
    assert all("%|" not in line for line in events), events
    assert [line for line in lines if BAR.match(line)], lines
    code, output = on_a_terminal(run)
    events = [line for line in shown(output) if line and not BAR.match(line)]
    assert code == 0
    (going_on,) = events
    assert re.fullmatch(r"going on: \d+ trials already done, \d+ to run", going_on)


def shown(output: str) -> list[str]:
    """The lines that are on a terminal in the end: a carriage return begins a line again."""
    return [line.rstrip("\r").rpartition("\r")[2].rstrip() for line in output.split("\n")]


@pytest.mark.long
def test_without_a_terminal_it_is_quiet_but_for_events(tmp_path, undisturbed):
    """No bar; each event is one line, the table is the output's."""
    run = Run(tmp_path)
    gate = run.gate(40)
    with run.begun(gate=gate) as process:
        when(run.parts, process)
        kill_one_that_waits(gate, process)
        gate.open()
        assert process.wait(300) == 0
    lines = run.err.splitlines()
    assert lines
    assert all(
        re.fullmatch(r"\S+ trials? \d+(\.\.\d+)?: .*worker died; running (it|them) again", line)
        for line in lines
    )
    assert "controller" not in run.err
    assert run.hashes() == undisturbed.hashes
