"""A contestant's process, as seen from here: start, ask, wait, end. See `subject` for what it is asked."""

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
    """What went wrong in a contestant's process, in one line."""


class Remote:
    """A process that answers requests one at a time; it sleeps in between."""

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
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._replies.put(line)
        self._replies.put("")  # it has ended

    def ask(self, do: str, timeout: float = TIMEOUT, **values: Any) -> dict[str, Any]:
        """Its reply; raises `SubjectError` for an error in it, none in time, or a process that is gone."""
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
        """Ask it to stop; make it stop."""
        try:
            self.ask("quit", timeout=10)
        except SubjectError:
            self.process.kill()
        self.process.wait(10)
