"""Tells a person what happens while a study runs: one line per event on stderr, above the progress
bar.
"""

import sys

from tqdm import tqdm


def log_event(line: str) -> None:
    """Writes a line for everybody, also for those who read a log."""
    tqdm.write(line, file=sys.stderr)


def log_on_terminal(line: str) -> None:
    """Writes a line for those who watch: nothing where stderr is no terminal."""
    if sys.stderr.isatty():
        log_event(line)


def log_off_terminal(line: str) -> None:
    """Writes a line for those who read a log: nothing where stderr is a terminal."""
    if not sys.stderr.isatty():
        log_event(line)
