"""Starts a contestant's process, asks it, waits for it and ends it; `subject` is the other side."""

import json
import os
import queue
import subprocess
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

SUBJECT = Path(__file__).with_name("subject.py")
TIMEOUT = 300  # s, for one reply: some compile for a minute


class SubjectError(Exception):
    """Says in one line what went wrong in a contestant's process."""


class Remote:
    """Represents a process that answers requests one at a time and sleeps in between."""

    def __init__(
        self, command: Sequence[str | os.PathLike], log: Path, env: Mapping[str, str] | None = None
    ) -> None:
        self.log = log
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("w") as stderr:
            self.process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=stderr,
                text=True,
                env=os.environ | dict(env or {}),
            )
        self._replies: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        """Queues each line that the process prints, and an empty one when it has ended."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._replies.put(line)
        self._replies.put("")  # it has ended

    def ask(self, do: str, timeout: float = TIMEOUT, **values: Any) -> dict[str, Any]:
        """Returns the reply to a request.

        Raises `SubjectError` if the reply is an error, comes too late, or the process has ended.
        """
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(json.dumps({"do": do, **values}) + "\n")
            self.process.stdin.flush()
            line = self._replies.get(timeout=timeout)
        except queue.Empty:
            self.process.kill()  # it would keep the CPU busy while others are timed
            raise SubjectError(f"no reply to {do!r} in {timeout:g} s") from None
        except OSError:
            line = ""
        if not line:
            raise SubjectError(f"ended with code {self.process.wait(10)} at {do!r}, see {self.log}")
        reply = json.loads(line)
        if "error" in reply:
            raise SubjectError(reply["error"])
        return reply

    def end(self) -> None:
        """Asks the process to stop, and kills it if it does not."""
        try:
            self.ask("quit", timeout=10)
        except SubjectError:
            self.process.kill()
        self.process.wait(10)
