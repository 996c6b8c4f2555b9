"""The command as a user runs it, timed and watched from outside through /proc."""

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
    """What went wrong with a command, in one line."""


class Ended(NamedTuple):
    """When a command was started (s since the epoch, as the times of files are) and how long it took (s)."""

    started: float
    seconds: float


def run(args: Sequence[str], folder: Path, env: Mapping[str, str] | None = None) -> Ended:
    """`mppi-belief ARGS` in `folder`, to its end."""
    return watched(args, folder, lambda pid: None, env)


def watched(
    args: Sequence[str],
    folder: Path,
    look: Callable[[int], object],
    env: Mapping[str, str] | None = None,
    every: float = 0.005,
) -> Ended:
    """The same, with `look(pid)` called again and again while it runs; raises `CommandError` unless it exits with 0."""
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
        said = (log.read_text().strip().splitlines() or ["no word"])[-1]
        raise CommandError(f"{' '.join(args)}: code {process.returncode}: {said}")
    return Ended(started, seconds)


def workers_of(pid: int) -> list[int]:
    """The pool's processes of a running command."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            if (
                entry.name.isdigit()
                and _parent(entry) == pid
                and b"--multiprocessing-fork" in _words(entry)
            ):
                found.append(int(entry.name))
        except OSError:  # it has just ended
            continue
    return sorted(found)


def _parent(entry: Path) -> int:
    return int((entry / "stat").read_text().rpartition(")")[2].split()[1])


def _words(entry: Path) -> list[bytes]:
    return (entry / "cmdline").read_bytes().split(b"\0")


def programs(cache: Path) -> int:
    """Compiled programs in a compilation cache."""
    return sum(1 for path in cache.rglob("*-cache"))


def resident_mb(pid: int) -> float | None:
    """What a process holds in memory (RSS); None for one that has ended."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE_MB
    except (OSError, IndexError):
        return None


def peak_mb(pid: int) -> float:
    """The most that a running process ever held in memory."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1.024e-3
    raise CommandError(f"no memory is told of process {pid}")
