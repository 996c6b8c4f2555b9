"""Turns what Hydra, OmegaConf and the yaml parser raise into one line that names the key and what
is allowed.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from difflib import get_close_matches

import yaml

from ..errors import ConfigError, first_line
from .misspelt_keys import unknown_key_line

TYPES = {"Float": "a number", "Integer": "a whole number", "Boolean": "true or false"}


def config_error_line(error: BaseException, folders: Sequence[str] = ()) -> str:
    """Returns what is wrong, in one line; `folders` are those of `--config-dir`."""
    causes = list(_causes(error))
    for cause in causes:
        if isinstance(cause, ConfigError):
            return str(cause)
        if isinstance(cause, RecursionError):
            return "nested too deeply, or something that contains itself"
        if isinstance(cause, UnicodeDecodeError):
            return "a yaml file must be UTF-8 text"
        if isinstance(cause, yaml.MarkedYAMLError):
            return _yaml_line(cause)
    text = "\n".join(map(str, causes))  # the messages of all, outermost first
    for pattern, describe in _MESSAGES:
        match = re.search(pattern, text, re.DOTALL)
        if match:
            return describe(match, folders)
    return first_line(text) or type(error).__name__


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    """Yields an exception and those that it comes from."""
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def _yaml_line(error: yaml.MarkedYAMLError) -> str:
    """Returns file, line and reason of a yaml error."""
    mark = error.problem_mark
    where = f"{mark.name}:{mark.line + 1}: " if mark else ""
    return f"{where}{error.problem}"


def _unknown_key(match: re.Match[str], folders: Sequence[str]) -> str:
    return unknown_key_line(match["key"].strip("'\"+~"), folders)


def _unknown_option(match: re.Match[str], folders: Sequence[str]) -> str:
    group, _, option = match["choice"].rpartition("/")
    options = [line.strip() for line in match["options"].splitlines() if line.strip()]
    near = get_close_matches(option, options, n=1)
    guess = f"; did you mean '{near[0]}'?" if near else ""
    return f"{group}={option}: no such option, choose from {', '.join(options)}{guess}"


def _wrong_type(match: re.Match[str], folders: Sequence[str]) -> str:
    wanted = TYPES.get(match["type"], match["type"])
    return f"{match['key']} must be {wanted}, got {match['value']}"


def _error_in_file(match: re.Match[str], folders: Sequence[str]) -> str:
    return f"{match['file']}.yaml: {match['why'].strip()}"


_MESSAGES: list[tuple[str, Callable[[re.Match[str], Sequence[str]], str]]] = [
    (
        r"Could not find '(?P<choice>[^']+)'\s+Available options in '[^']+':"
        r"\s+(?P<options>[^\n]+(?:\n\t[^\n]+)*)",
        _unknown_option,
    ),
    (r"Could not override '(?P<key>[^']+)'.*is not in struct", _unknown_key),
    (r"Key '[^']+' (?:is not in struct|not in '[^']+')\s+full_key: (?P<key>\S+)", _unknown_key),
    (
        r"Could not override '(?P<key>[^'=@]+)(?:@[^']*)?'\.?\s*(?:No match in|Did you mean)",
        _unknown_key,
    ),
    (
        r"Value '(?P<value>[^']*)'.*?could not be converted to (?P<type>\w+)"
        r"\s+full_key: (?P<key>\S+)",
        _wrong_type,
    ),
    (
        r"In '(?P<file>[^']+)': \w+ raised while composing config:\s+(?P<why>[^\n]+)",
        _error_in_file,
    ),
]
