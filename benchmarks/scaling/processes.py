"""Runs the command as a user does, times it, and watches it from outside through /proc."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

PYTHON = Path(sys.executable)
COMMAND = PYTHON.with_name("mppi-belief")
TIMEOUT = 600  # s, for one command
PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 1e6


class CommandError(Exception):
    """Says in one line what went wrong with a command."""


class Ended(NamedTuple):
    """Holds when a command was started and how long it took."""

    started: float  # s since the epoch, as the times of files are
    seconds: float  # how long it took


def run(args: Sequence[str], folder: Path, env: Mapping[str, str] | None = None) -> Ended:
    """Runs `mppi-belief ARGS` in `folder` to its end."""
    return watched(args, folder, lambda pid: None, env)


def watched(
    args: Sequence[str],
    folder: Path,
    look: Callable[[int], object],
    env: Mapping[str, str] | None = None,
    every: float = 0.005,
) -> Ended:
    """Runs a command and calls `look(pid)` again and again until it ends.

    Raises `CommandError` unless it exits with 0.
    """
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "stderr.txt"
    with log.open("w") as stderr:
        started = time.time()
        began = time.perf_counter()
        process = subprocess.Popen(
            [COMMAND, *args],
            cwd=folder,
            env=os.environ | dict(env or {}),
            stdout=subprocess.DEVNULL,
            stderr=stderr,
        )
        try:
            while process.poll() is None:
                if time.perf_counter() - began > TIMEOUT:
                    raise CommandError(f"{' '.join(args)}: not done in {TIMEOUT} s")
                look(process.pid)
                time.sleep(every)
        finally:
            if process.poll() is None:
                process.terminate()  # its workers end with it
                process.wait(60)
        seconds = time.perf_counter() - began
    if process.returncode:
        last_message = (log.read_text().strip().splitlines() or ["no word"])[-1]
        raise CommandError(f"{' '.join(args)}: code {process.returncode}: {last_message}")
    return Ended(started, seconds)


def workers_of(pid: int) -> list[int]:
    """Returns the worker processes of a running command."""
    pids = []
    for entry in Path("/proc").iterdir():
        try:
            if (
                entry.name.isdigit()
                and _parent(entry) == pid
                and b"--multiprocessing-fork" in _words(entry)
            ):
                pids.append(int(entry.name))
        except OSError:  # it has just ended
            continue
    return sorted(pids)


def _parent(entry: Path) -> int:
    """Returns the parent of a process by its folder in /proc."""
    return int((entry / "stat").read_text().rpartition(")")[2].split()[1])


def _words(entry: Path) -> list[bytes]:
    """Returns the command line of a process by its folder in /proc."""
    return (entry / "cmdline").read_bytes().split(b"\0")


def programs(cache: Path) -> int:
    """Returns the number of compiled programs in a compilation cache."""
    return sum(1 for path in cache.rglob("*-cache"))


def resident_mb(pid: int) -> float | None:
    """Returns the resident memory of a process in MB; None if it has ended."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE_MB
    except (OSError, IndexError):
        return None


def peak_mb(pid: int) -> float:
    """Returns the most memory that a running process ever held, in MB."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1.024e-3
    raise CommandError(f"no memory is told of process {pid}")
