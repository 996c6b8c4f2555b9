"""Stands in for standard streams that whoever started this process has closed (`>&-`, `2>&-`).

Python has None in their place, and the system gives their numbers to the next files that are
opened: a results file could receive what a library prints.
"""

import os
import sys


def open_closed_streams() -> None:
    """Opens the null device in the place of each standard stream that is closed."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is not None:
            continue
        if not _is_open(number):
            null = os.open(os.devnull, os.O_RDWR)
            if null != number:
                os.dup2(null, number)
                os.close(null)
            os.set_inheritable(number, True)  # workers have the same streams
        mode = "r" if name == "stdin" else "w"
        setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115


def _is_open(number: int) -> bool:
    """Returns whether a file descriptor is in use."""
    try:
        os.fstat(number)
    except OSError:
        return False
    return True
