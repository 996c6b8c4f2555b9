"""Finds the line of a user's own code in which an exception was raised."""

import re
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path

_FRAME_IN_TEXT = re.compile(r'File "([^"]+)", line (\d+)')


def source_line(error: BaseException, folders: Sequence[str]) -> str:
    """Returns the innermost line of an exception that lies in one of the folders, such as
    "mine.py, line 12"; "" if there is none.

    The exception of a callback comes as the text of a traceback within another exception.
    """
    for file, line in reversed([*_frames(error), *_frames_in_text(str(error))]):
        for folder in map(Path, folders):
            if Path(file).is_relative_to(folder):
                return f"{Path(file).relative_to(folder)}, line {line}"
    return ""


def _frames(error: BaseException) -> Iterator[tuple[str, int]]:
    """Yields file and line of the calls that led to an exception and to its causes, the causes
    last.
    """
    for frame in traceback.extract_tb(error.__traceback__):
        yield frame.filename, frame.lineno or 0
    if error.__cause__ is not None:
        yield from _frames(error.__cause__)


def _frames_in_text(text: str) -> Iterator[tuple[str, int]]:
    """Yields file and line of the calls in a traceback that was made into text."""
    for match in _FRAME_IN_TEXT.finditer(text):
        yield match[1], int(match[2])
