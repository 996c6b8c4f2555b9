"""The command line, called in this process or in one of its own."""

import copy
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from mppi_belief.cli import main as cli
from mppi_belief.cli import run
from mppi_belief.config import compose as composing
from mppi_belief.config import targets
from mppi_belief.config.conf_files import conf_dir

COMMAND = str(Path(sys.executable).with_name("mppi-belief"))
CONF = conf_dir()
PLANNER = ("planner.n_samples=16", "planner.horizon=4", "problem.steps=3")
SMALL = ("system=scalar_linear", *PLANNER)
SLOW_START = re.compile(r"\bcompiling (or|and) (computing|checking) ")  # see run/slow_starts.py
TIMEOUT = 120  # s, only so that a test that hangs ends


class Said(NamedTuple):
    """How a command ended and what it printed."""

    code: int
    out: str
    err: str


@contextmanager
def restored() -> Iterator[None]:
    """Undo what a command does to its own process."""
    argv = list(sys.argv)
    path = list(sys.path)
    environment = dict(os.environ)
    folder = Path.cwd()
    allowed = list(targets.ALLOWED_FOLDERS)
    try:
        yield
    finally:
        sys.argv = argv
        sys.path[:] = path
        targets.ALLOWED_FOLDERS[:] = allowed
        os.chdir(folder)
        os.environ.clear()
        os.environ.update(environment)


def call(cwd: Path, capsys: pytest.CaptureFixture[str], *args: str, **env: str) -> Said:
    """`mppi-belief ARGS` in this process: no start-up to wait for."""
    with restored():
        os.chdir(cwd)
        os.environ.update(env)
        sys.argv = ["mppi-belief", *args]
        capsys.readouterr()
        code = cli.main()
        return Said(code, *capsys.readouterr())


def collect(*args: str) -> list[dict[str, Any]]:
    """The configurations that `mppi-belief run ARGS` would run."""
    return copy.deepcopy(_collected(args))


@cache
def _collected(args: tuple[str, ...]) -> list[dict[str, Any]]:
    with restored():
        return composing.collect(run.parse(args))


def compose(*args: str) -> dict[str, Any]:
    """The one configuration that `mppi-belief run ARGS` would run."""
    (config,) = collect(*args)
    return config


def command(cwd: Path, *args: str, **env: str) -> Said:
    """`mppi-belief ARGS` as a user runs it."""
    done = subprocess.run(
        [COMMAND, *args],
        cwd=cwd,
        env=os.environ | env,
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
    )
    return Said(done.returncode, done.stdout, without_slow_starts(done.stderr))


def without_slow_starts(err: str) -> str:
    """What a command wrote to stderr, without the lines that only a slow machine sees."""
    lines = err.splitlines(keepends=True)
    return "".join(line for line in lines if not SLOW_START.search(line))


def python(code: str, cwd: Path) -> str:
    """What a fresh interpreter prints when it runs `code`."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@contextmanager
def started(
    cwd: Path, *args: str, stdout: int = subprocess.DEVNULL, **how: Any
) -> Iterator[subprocess.Popen[str]]:
    """The command in the background, in a process group of its own as a shell would give it; never
    left behind. `how` is for Popen.
    """
    log = cwd / "stderr.txt"
    with log.open("w") as stderr:
        process = subprocess.Popen(
            [COMMAND, *args],
            cwd=cwd,
            stdout=stdout,
            stderr=stderr,
            text=True,
            start_new_session=True,
            **how,
        )
        try:
            yield process
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.wait(TIMEOUT)


def files_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())
