"""Errors that a person can mend, each in one line."""

from collections.abc import Sequence
from difflib import get_close_matches

LONGEST_LINE = 600  # characters that are still read


class ConfigError(Exception):
    """A person's input is wrong; the message is one line that says what and where."""

    def __init__(self, message: str) -> None:
        super().__init__(plain_line(message))


def plain_line(text: str) -> str:
    """The text as one line that any terminal can print: what is not printable is escaped, what is endless is cut."""
    shown = "".join(
        sign if sign.isprintable() else sign.encode("unicode_escape").decode() for sign in text
    )
    return shown if len(shown) <= LONGEST_LINE else f"{shown[: LONGEST_LINE - 4]} ..."


def first_line(error: BaseException) -> str:
    """Return the first line of what an exception says, or its name if it says nothing."""
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__


def unknown_key(
    key: str, known: Sequence[str], what: str = "key", see: str = "mppi-belief run --help"
) -> str:
    """One line about a misspelt key, or another name, with the nearest known one."""
    near = get_close_matches(key, known, n=1)
    return f"unknown {what} '{key}'" + (f"; did you mean '{near[0]}'?" if near else f"; see {see}")
