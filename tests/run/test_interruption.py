"""The real command, interrupted in every way: no result is lost, none is computed twice, the
numbers stay the same.
"""

import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from cli_helpers import TIMEOUT, Said, command, started
from gate_helpers import GATED, Gate
from mppi_belief.results import table as results
from mppi_belief.results.contents import read_cell, read_rows
from study_helpers import members, poll

N_TRIALS = 400
STEPS = 50
ADMITTED = (
    20  # trials that may begin before an interruption: two chunks, however fast the machine is
)
STUDY = [
    "run",
    "--config-dir",
    GATED,
    "controller=gated_belief",
    "system=scalar_linear",
    "planner.n_samples=16",
    "planner.horizon=4",
    f"problem.steps={STEPS}",
    f"n_trials={N_TRIALS}",
]


class Interrupted(NamedTuple):
    """How a command ended that was interrupted after its first results, and the trials done by
    then.
    """

    code: int
    err: str
    trials: list[int]
    survivors: list[int]  # processes that outlived it


def part_files(folder: Path) -> set[Path]:
    return set(folder.glob("outputs/results/*/part-*"))


def rows(folder: Path) -> Any:
    (cell,) = (folder / "outputs" / "results").iterdir()
    return read_rows(cell)


def interrupt(folder: Path, gate: Gate, how: Callable[[int], None]) -> Interrupted:
    """Start the study, call `how` with its process id when a new part file is there, and wait."""
    before = part_files(folder)
    log = folder / "stderr.txt"
    with started(folder, *STUDY, env=gate.environment) as process:
        poll(lambda: part_files(folder) - before or process.poll() is not None, TIMEOUT)
        assert process.poll() is None, "a command ends while its trials wait"
        how(process.pid)
        poll(lambda: "stopping" in log.read_text() or process.poll() is not None, TIMEOUT)
        gate.open()
        code = process.wait(TIMEOUT)
        try:
            poll(lambda: not members(process.pid), TIMEOUT)
        finally:
            survivors = members(process.pid)
    return Interrupted(code, log.read_text(), rows(folder)["trial"].tolist(), survivors)


class Story(NamedTuple):
    """A study with two workers, interrupted three times and then left alone."""

    folder: Path
    ctrl_c: Interrupted
    terminated: Interrupted
    killed: Interrupted
    last: Said


@pytest.fixture(scope="module")
def story(tmp_path_factory) -> Story:
    folder = tmp_path_factory.mktemp("interrupted")
    gates = [Gate(folder / f"gate-{number}", ADMITTED) for number in range(3)]
    # a terminal sends Ctrl-C to all processes of the command
    ctrl_c = interrupt(folder, gates[0], lambda pid: os.killpg(pid, signal.SIGINT))
    terminated = interrupt(folder, gates[1], lambda pid: os.kill(pid, signal.SIGTERM))
    killed = interrupt(folder, gates[2], lambda pid: os.kill(pid, signal.SIGKILL))
    return Story(folder, ctrl_c, terminated, killed, command(folder, *STUDY))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory) -> Path:
    """The same study in one run of one worker."""
    folder = tmp_path_factory.mktemp("undisturbed")
    ended_command = command(folder, *STUDY, "workers=1")
    assert ended_command.code == 0, ended_command.err
    return folder


def test_signals_end_it_with_their_exit_code_and_one_word_on_how_to_go_on(story):
    assert (story.ctrl_c.code, story.terminated.code) == (130, 143)
    for ended in (story.ctrl_c, story.terminated):
        assert "the same command goes on from here" in ended.err
        assert "Traceback" not in ended.err


def test_every_interruption_keeps_what_is_done(story):
    done = [ended.trials for ended in (story.ctrl_c, story.terminated, story.killed)]
    assert 0 < len(done[0]) < len(done[1]) < len(done[2]) < N_TRIALS
    assert set(done[0]) < set(done[1]) < set(done[2])


def test_no_process_outlives_an_interruption(story):
    assert [ended.survivors for ended in (story.ctrl_c, story.terminated, story.killed)] == [
        [],
        [],
        [],
    ]
    assert story.killed.code == -signal.SIGKILL


def test_the_same_command_completes_it(story):
    n_done = len(story.killed.trials)
    assert story.last.code == 0, story.last.err
    assert f"{N_TRIALS - n_done} trials run, {n_done} already done" in story.last.out
    table = rows(story.folder)
    assert table["trial"].tolist() == list(range(N_TRIALS))
    assert set(table["status"]) == {"ok"}


def test_results_are_the_same_bits_with_one_or_two_workers_in_one_or_many_runs(story, undisturbed):
    assert results.result_hash(rows(story.folder)) == results.result_hash(rows(undisturbed))
    names = [
        next((folder / "outputs" / "results").iterdir()) for folder in (story.folder, undisturbed)
    ]
    assert names[0].name == names[1].name
    first, second = (read_cell(cell).steps for cell in names)
    assert len(first) == 50 * (STEPS + 1)
    for column in ("trial", "step", "state", "mean", "cov", "control"):
        np.testing.assert_array_equal(np.vstack(first[column]), np.vstack(second[column]))


def test_files_say_how_they_were_made(undisturbed):
    (cell,) = (undisturbed / "outputs" / "results").iterdir()
    commands = [
        results.read_table(path)[0]["sources"][0]["command"] for path in cell.glob("part-*")
    ]
    assert commands == [["mppi-belief", *STUDY, "workers=1"]] * len(commands)
    config = results.read_table(next(cell.glob("part-*")))[0]["sources"][0]["config"]
    assert (config["names"]["system"], config["problem"]["steps"]) == ("scalar_linear", STEPS)


def test_an_interruption_while_it_starts_prints_no_traceback(tmp_path):
    gate = Gate(tmp_path / "gate", 0)
    with started(tmp_path, *STUDY, env=gate.environment) as process:
        poll(lambda: "jaxlib" in Path(f"/proc/{process.pid}/maps").read_text(), TIMEOUT)
        process.send_signal(signal.SIGINT)
        gate.open()
        code = process.wait(TIMEOUT)
    ended_command = (tmp_path / "stderr.txt").read_text()
    assert "Traceback" not in ended_command
    assert code in (130, -signal.SIGINT)  # which a shell calls 130 too
