"""Keeps a picture that cannot be drawn from ending the command whose results it shows."""

import sys
from collections.abc import Callable
from typing import TypeVar

from ..errors import first_line, plain_line

Drawn = TypeVar("Drawn")


def drawn(picture: str, draw: Callable[[], Drawn]) -> Drawn | None:
    """Returns what `draw` returns; None where it raises, with one line on stderr that says why.

    Everything that draws a picture of stored results is called through this function. The exit
    code of a command is that of its results.
    """
    try:
        return draw()
    except Exception as error:
        line = f"no picture {picture} ({type(error).__name__}: {first_line(error)})"
        print(plain_line(line), file=sys.stderr)
        return None
