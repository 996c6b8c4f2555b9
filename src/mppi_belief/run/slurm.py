"""Jobs of Slurm that hold Dask workers: as many as were asked for, whatever ends them.

sbatch     submits one job after another, all of one script and one name
squeue     lists those that are left; asked at ever longer intervals while workers are missing
scancel    cancels them all
"""

import os
import subprocess
import time
from collections.abc import Collection
from typing import Any

from ..errors import ConfigError, first_line
from .local import FAILED_STARTS
from .workers import WorkersGone

SHORTEST_INTERVAL = 1.0  # s between two looks at the queue, at first
LONGEST_INTERVAL = 30.0  # s between two looks at the queue, later
COMMAND_TIMEOUT = 60.0  # s that a command of Slurm may take
# Words in Slurm's messages when its controller cannot be reached.
UNREACHABLE = ("contact", "timed out", "timeout")
COMPLETING = "CG"  # the state of a job that has ended


class SlurmJobs:
    """Keeps `wanted` jobs of a script in the queue, each with `per_job` workers named `<job>` or
    `<job>-<number>`.
    """

    def __init__(self, script: str, name: str, wanted: int, per_job: int = 1) -> None:
        self._script = script
        self._name = name
        self._wanted = wanted
        self._per_job = per_job
        self._queued: set[str] = set()  # ids of the jobs that the queue had when last asked
        self._connected: set[str] = set()  # ids of the jobs of which a worker has ever connected
        self._fruitless = 0  # jobs in a row that ended before a worker connected
        self._worker_count = 0
        self._interval = SHORTEST_INTERVAL
        self._next_look = 0.0  # s, by the monotonic clock

    def replace_missing(self, names: Collection[Any]) -> None:
        """Submits jobs in the place of those that have ended; `names` are those of the connected
        workers.

        Raises `ConfigError` where Slurm takes none of them, `WorkersGone` where they end before a
        worker connects.
        """
        connected = {str(name).partition("-")[0] for name in names}
        if connected - self._connected:
            self._fruitless = 0
        self._connected |= connected

        # Look soon after workers came or went, and then at ever longer intervals.
        now = time.monotonic()
        if self._queued and len(names) != self._worker_count:
            self._interval = SHORTEST_INTERVAL
            self._next_look = now + SHORTEST_INTERVAL
        self._worker_count = len(names)
        if len(names) < self._wanted * self._per_job and now >= self._next_look:
            self._forget_ended()
            self._submit_missing()
            self._interval = min(2 * self._interval, LONGEST_INTERVAL)
            self._next_look = time.monotonic() + self._interval

    def cancel_all(self) -> None:
        """Cancels all jobs; ignores errors of Slurm."""
        if self._queued:
            _call("scancel", f"--name={self._name}")

    def _forget_ended(self) -> None:
        """Forgets the jobs that have left the queue; raises `WorkersGone` if too many of them were
        fruitless.
        """
        if not self._queued:
            return
        answer = _call("squeue", "--noheader", "--format=%A %t", f"--name={self._name}")
        if answer.returncode:
            return  # a controller that does not answer says nothing about jobs
        lines = [line.split() for line in answer.stdout.splitlines()]
        ended = self._queued - {job for job, state in lines if state != COMPLETING}
        self._queued -= ended
        self._fruitless += len(ended - self._connected)
        if self._fruitless >= FAILED_STARTS and not self._worker_count:
            raise WorkersGone(
                f"{self._fruitless} jobs ended before a worker connected"
                " (executor.logs=FOLDER keeps why)"
            )

    def _submit_missing(self) -> None:
        while len(self._queued) < self._wanted:
            answer = _call("sbatch", "--parsable", script=self._script)
            if answer.returncode == 0:
                self._queued.add(answer.stdout.strip().partition(";")[0])
            elif self._queued:
                return  # a limit on jobs: those that are there do the work
            else:
                raise self._refusal(answer.stderr)

    def _refusal(self, message: str) -> Exception:
        """Returns the error for a job that sbatch refused with a message."""
        lines = message.splitlines()
        errors = [line.partition("error: ")[2] for line in lines if "error: " in line]
        line = errors[-1] if errors else first_line(message) or "it does not say why"
        if any(word in line.lower() for word in UNREACHABLE):
            return WorkersGone(f"Slurm does not answer: {line}")
        if self._connected:
            return WorkersGone(f"sbatch takes no more jobs: {line}")
        return ConfigError(f"executor=slurm: sbatch refuses the job: {line}")


def _call(*command: str, script: str | None = None) -> "subprocess.CompletedProcess[str]":
    """Calls a command of Slurm in a session of its own, since a Ctrl-C is this process's alone.

    Raises `ConfigError` where Slurm is not installed.
    """
    # Variables of a job that this process may run in would become options of the new one.
    environment = {
        key: value
        for key, value in os.environ.items()
        if not key.startswith("SLURM_") or key == "SLURM_CONF"
    }
    try:
        return subprocess.run(
            command,
            input=script,
            env=environment,
            capture_output=True,
            text=True,
            timeout=COMMAND_TIMEOUT,
            start_new_session=True,
        )
    except FileNotFoundError as error:
        raise ConfigError(f"executor=slurm: there is no {command[0]} on this machine") from error
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(command, 1, "", f"{command[0]} timed out")
