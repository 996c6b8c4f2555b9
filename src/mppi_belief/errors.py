"""Defines the error that a person can mend, and what makes messages plain: one line, a plural."""

from collections.abc import Sequence
from difflib import get_close_matches

LONGEST_LINE = 600  # characters; a longer message is cut


class ConfigError(Exception):
    """Says in one line what in a person's input is wrong, and where."""

    def __init__(self, message: str) -> None:
        super().__init__(plain_line(message))


class FieldError(ConfigError):
    """Says what is wrong with the value of one key, which may be taken from another key."""

    def __init__(self, key: str, reason: str) -> None:
        super().__init__(f"{key}{reason}")
        self.key = key  # dotted, of the composed configuration
        self.reason = reason  # follows the key in the message: " must be at least 1, got 0"


def plain_line(text: str) -> str:
    """Returns the text as one line that any terminal can print.

    Characters that cannot be printed are escaped, and a line beyond `LONGEST_LINE` is cut.
    """
    line = "".join(
        sign if sign.isprintable() else sign.encode("unicode_escape").decode() for sign in text
    )
    return line if len(line) <= LONGEST_LINE else f"{line[: LONGEST_LINE - 4]} ..."


def first_line(error: BaseException | str) -> str:
    """Returns the first line of a text or of an exception, whose name it is if it says nothing."""
    lines = str(error).strip().splitlines()
    if lines:
        return lines[0].strip()
    return "" if isinstance(error, str) else type(error).__name__


def counted(number: int, noun: str) -> str:
    """Returns a number with its noun in the right form: "1 cell", "3 cells"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def unknown_key(
    key: str, known: Sequence[str], what: str = "key", see: str = "mppi-belief run --help"
) -> str:
    """Returns one line about a misspelt key or other name, with the nearest known one."""
    nearest = get_close_matches(key, known, n=1)
    advice = f"did you mean '{nearest[0]}'?" if nearest else f"see {see}"
    return f"unknown {what} '{key}'; {advice}"
