"""What a person is told while a study runs: a line an event on stderr, the progress bar stays whole."""

import sys

from tqdm import tqdm


def say(line: str) -> None:
    """An event worth knowing, for whoever reads the log, too."""
    tqdm.write(line, file=sys.stderr)


def note(line: str) -> None:
    """The same for whoever watches: nothing where stderr is no terminal."""
    if sys.stderr.isatty():
        say(line)
