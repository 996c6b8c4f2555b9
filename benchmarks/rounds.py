"""Runs interleaved rounds: all contestants are compiled, then A B C, A B C, ... take turns on one
CPU.

A drift of the machine then affects all alike. A contestant that fails is left out with its reason;
the others go on.
"""

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from remote import SUBJECT, Remote, SubjectError


class Asked(Protocol):
    """Describes what answers requests, see `remote.Remote`."""

    def ask(self, do: str, **values: Any) -> dict[str, Any]: ...

    def end(self) -> None: ...


def start(
    python: str | Path,
    module: str,
    name: str,
    cpu: int,
    log: Path,
    env: Mapping[str, str] | None = None,
    subject: Path = SUBJECT,
) -> Remote:
    """Starts the process of one contestant, pinned to `cpu`; `subject` is the program that
    serves it.
    """
    return Remote([python, subject, module, name, str(cpu)], log, env)


def one_cpu() -> int:
    """Returns the last CPU that this process may use; the first one serves most interrupts."""
    return max(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 0


def measure(
    subjects: dict[str, Asked], workload: dict[str, Any], dtype: str, rounds: int, calls: int
) -> dict[str, dict[str, Any]]:
    """Returns by name: versions, settings, closed loop and `rounds` (a list of seconds for each).

    A contestant that failed has `error` instead.
    """
    results: dict[str, dict[str, Any]] = {name: {"rounds": []} for name in subjects}

    def ask(name: str, do: str, **values: Any) -> dict[str, Any]:
        if "error" in results[name]:
            return {}
        try:
            return subjects[name].ask(do, **values)
        except SubjectError as error:
            results[name]["error"] = str(error)
            say(f"{name} {dtype}: {error}")
            return {}

    for name in subjects:
        say(f"preparing {name} {dtype}")
        results[name] |= ask(name, "prepare", workload=workload, dtype=dtype)
        results[name] |= ask(name, "closed_loop")
        ask(name, "time", calls=1)  # compiles
    for k in range(rounds):
        say(f"round {k + 1} of {rounds}, {dtype}")
        # Every other round runs backwards, so that no contestant gains from its neighbour.
        for name in subjects if k % 2 == 0 else reversed(subjects):
            if times := ask(name, "time", calls=calls):
                results[name]["rounds"].append(times["seconds"])
    return results


def end(subjects: Sequence[Asked]) -> None:
    """Ends all contestants."""
    for subject in subjects:
        subject.end()


def say(line: str) -> None:
    """Prints a line of progress to stderr."""
    print(line, file=sys.stderr, flush=True)
