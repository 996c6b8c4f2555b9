"""Jobs of Slurm that hold Dask workers: as many as were asked for, whatever ends them.

sbatch     one job after another, all of one script and one name
squeue     which of them are still there; asked only while workers are missing, at ever longer intervals
scancel    ends them all
"""

import os
import subprocess
import time
from collections.abc import Collection
from typing import Any

from ..errors import ConfigError
from .local import STARTS, WorkersGone

SOONEST, LATEST = 1.0, 30.0  # s between two looks at the queue
PATIENCE = 60.0  # s that a command of Slurm may take
UNREACHABLE = (
    "contact",
    "timed out",
    "timeout",
)  # what Slurm says where only its controller is away


class Jobs:
    """`wanted` jobs of a script, each with `per_job` workers that carry its number in their names."""

    def __init__(self, script: str, name: str, wanted: int, per_job: int = 1) -> None:
        self._script, self._name, self._wanted, self._per_job = script, name, wanted, per_job
        self._there: set[str] = set()
        self._came: set[str] = set()
        self._fruitless = 0  # jobs in a row that ended before a worker came
        self._workers, self._pause, self._next = 0, SOONEST, 0.0

    def tend(self, names: Collection[Any]) -> None:
        """Replace jobs that have ended, seen by the names of the workers that are there.

        Raises `ConfigError` where Slurm takes none of them, `WorkersGone` where they end before they work.
        """
        came = {str(name).partition("-")[0] for name in names}
        if came - self._came:
            self._fruitless = 0
        self._came |= came
        now = time.monotonic()
        if self._there and len(names) != self._workers:
            self._pause, self._next = SOONEST, now + SOONEST
        self._workers = len(names)
        if len(names) < self._wanted * self._per_job and now >= self._next:
            self._bury()
            self._submit()
            self._pause = min(2 * self._pause, LATEST)
            self._next = time.monotonic() + self._pause

    def end(self) -> None:
        """Cancel them all; what goes wrong with that is Slurm's."""
        if self._there:
            _call("scancel", f"--name={self._name}")

    def _bury(self) -> None:
        """Forget the jobs that have left the queue."""
        if not self._there:
            return
        asked = _call("squeue", "--noheader", "--format=%A %t", f"--name={self._name}")
        if asked.returncode:
            return  # a controller that does not answer says nothing about jobs
        lines = [line.split() for line in asked.stdout.splitlines()]
        gone = self._there - {line[0] for line in lines if line[1] != "CG"}
        self._there -= gone
        self._fruitless += len(gone - self._came)
        if self._fruitless >= STARTS and not self._workers:
            raise WorkersGone(
                f"{self._fruitless} jobs ended before a worker came (executor.logs=FOLDER keeps why)"
            )

    def _submit(self) -> None:
        while len(self._there) < self._wanted:
            asked = _call("sbatch", "--parsable", script=self._script)
            if asked.returncode == 0:
                self._there.add(asked.stdout.strip().partition(";")[0])
            elif self._there:
                return  # a limit on jobs: those that are there do the work
            else:
                self._refused(asked.stderr)

    def _refused(self, said: str) -> None:
        errors = [line.partition("error: ")[2] for line in said.splitlines() if "error: " in line]
        line = errors[-1] if errors else said.strip().partition("\n")[0] or "it does not say why"
        if any(word in line.lower() for word in UNREACHABLE):
            raise WorkersGone(f"Slurm does not answer: {line}")
        if self._came:
            raise WorkersGone(f"sbatch takes no more jobs: {line}")
        raise ConfigError(f"executor=slurm: sbatch refuses the job: {line}")


def _call(*command: str, script: str | None = None) -> "subprocess.CompletedProcess[str]":
    """A command of Slurm, in a session of its own: a Ctrl-C is this process's alone. Raises `ConfigError` where Slurm
    is not installed."""
    outside = {
        key: value
        for key, value in os.environ.items()
        if not key.startswith("SLURM_") or key == "SLURM_CONF"
    }
    try:
        return subprocess.run(
            command,
            input=script,
            env=outside,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            start_new_session=True,
        )
    except FileNotFoundError as error:
        raise ConfigError(f"executor=slurm: there is no {command[0]} on this machine") from error
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(command, 1, "", f"{command[0]} timed out")
