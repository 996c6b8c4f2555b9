"""Tests what stands in for standard streams that whoever started the command has closed."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from cli_helpers import COMMAND, call
from mppi_belief.cli import main as cli

PROGRAM = """
import os, sys
from mppi_belief.run.streams import open_closed_streams
open_closed_streams()
file = os.open("results", os.O_CREAT | os.O_WRONLY)
print("to nobody", flush=True)
print("to nobody", file=sys.stderr)
os._exit(0 if file > 2 and sys.stdin.read() == "" else 1)
"""


def test_no_file_gets_the_number_of_a_closed_stream(tmp_path):
    words = shlex.join([sys.executable, "-c", PROGRAM])
    done = subprocess.run(f"{words} <&- >&- 2>&-", shell=True, cwd=tmp_path, check=False)
    assert done.returncode == 0
    assert (tmp_path / "results").read_text() == ""


@pytest.mark.parametrize("streams", [">&-", ">&- 2>&- <&-"])
def test_a_command_without_its_streams_ends_as_with_them(streams, tmp_path):
    done = subprocess.run(
        f"{shlex.quote(COMMAND)} --version {streams}", shell=True, cwd=tmp_path, check=False
    )
    assert done.returncode == 0


def test_a_message_that_nobody_reads_does_not_change_the_exit_code(monkeypatch):
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w", buffering=1) as nobody:
        monkeypatch.setattr(sys, "stderr", nobody)
        assert cli.complain("nobody reads this", 2) == 2
        os.dup2(os.open(os.devnull, os.O_WRONLY), writing)


def test_a_working_directory_that_was_deleted_is_named(tmp_path, capsys, monkeypatch):
    def cwd() -> Path:
        raise FileNotFoundError(2, "No such file or directory")

    line = "mppi-belief: the working directory was deleted; change to one that exists\n"
    with monkeypatch.context() as deleted:
        deleted.setattr(Path, "cwd", cwd)
        assert cli.guarded(lambda: cli.carry_out("run", ["controller=ce"])) == 2
        assert capsys.readouterr().err == line
        assert cli.guarded(cwd) == 74
        assert capsys.readouterr().err == line
    assert call(tmp_path, capsys, "results").err == (
        "mppi-belief: results_dir=outputs/results: no such folder\n"
    )
