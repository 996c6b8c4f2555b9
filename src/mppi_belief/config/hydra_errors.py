"""Turns what Hydra, OmegaConf and the yaml parser raise into one line that names the key and what
is allowed.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from difflib import get_close_matches

import yaml

from ..errors import ConfigError, first_line
from .misspelt_keys import unknown_key_line

EMPTY = "''"  # how an empty value is shown
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


def _unknown_deleted_key(match: re.Match[str], folders: Sequence[str]) -> str:
    return unknown_key_line(match["key"], folders)


def _wrong_type(match: re.Match[str], folders: Sequence[str]) -> str:
    wanted = TYPES.get(match["type"], match["type"])
    return f"{match['key']} must be {wanted}, got {match['value'] or EMPTY}"


def _no_choice(match: re.Match[str], folders: Sequence[str]) -> str:
    return f"{match['key']} must be one of {match['options']}, got {match['value'] or EMPTY}"


def _interpolation_error(match: re.Match[str], folders: Sequence[str]) -> str:
    return f"{match['key']}: {match['why'][0].lower()}{match['why'][1:]}"


def _error_in_file(match: re.Match[str], folders: Sequence[str]) -> str:
    return f"{match['file']}.yaml: {match['why'].strip()}"


def _sentence(text: str) -> Callable[[re.Match[str], Sequence[str]], str]:
    """Returns a function that puts the named groups of a match into a text."""
    return lambda match, folders: text.format(**match.groupdict())


_MESSAGES: list[tuple[str, Callable[[re.Match[str], Sequence[str]], str]]] = [
    (
        r"Could not find '(?P<choice>[^']+)'\s+Available options in '[^']+':"
        r"\s+(?P<options>[^\n]+(?:\n\t[^\n]+)*)",
        _unknown_option,
    ),
    (r"Key '[^']+' (?:is not in struct|not in '[^']+')\s+full_key: (?P<key>\S+)", _unknown_key),
    (r"Could not override '(?P<key>[^']+)'.*is not in struct", _unknown_key),
    (
        r"Could not override '(?P<key>[^'=@]+)(?:@[^']*)?'\.?\s*(?:No match in|Did you mean)",
        _unknown_key,
    ),
    (
        r"Could not delete from config\. '(?P<key>[^']+)' does not exist",
        _unknown_deleted_key,
    ),
    (
        r"Could not delete from config\. The value of '(?P<key>[^']+)' is (?P<now>.*?) and not "
        r"(?P<value>[^\n]*)\.",
        _sentence("~{key}={value}: {key} is {now}, not {value}"),
    ),
    (
        r"Could not delete '(?P<word>[^']+)'\. No match in the defaults list",
        _sentence("~{word}: {word} is not chosen"),
    ),
    (
        r"Value '(?P<value>(?:(?!\n).)*?)' of type '\w+' could not be converted to (?P<type>\w+)"
        r"\s+full_key: (?P<key>\S+)",
        _wrong_type,
    ),
    (
        r"field '\w+' is not Optional\s+full_key: (?P<key>\S+)",
        _sentence("{key} must have a value, got null"),
    ),
    (
        r"Invalid type assigned: [^\n]* value: (?P<value>[^\n]*)\s+full_key: (?P<key>\S+)",
        _sentence("{key} must be a mapping of settings, got {value}"),
    ),
    (
        r"Cannot merge DictConfig with ListConfig\s+full_key: (?P<key>\S+)",
        _sentence("{key} must be a mapping of settings, got a list"),
    ),
    (
        r"Cannot convert '\w+' to string: '(?P<value>[^\n]*)'\s+full_key: (?P<key>\S+)",
        _sentence("{key} must be a text, got {value}"),
    ),
    (
        r"Invalid value '(?P<value>[^']*)', expected one of \[(?P<options>[^]]*)\]"
        r"\s+full_key: (?P<key>\S+)",
        _no_choice,
    ),
    (
        r"Interpolation key '(?P<source>[^']+)' not found\s+full_key: (?P<key>\S+)",
        _sentence("{key}: ${{{source}}} refers to a key that does not exist"),
    ),
    (
        r"Recursive interpolation detected\s+full_key: (?P<key>\S+)",
        _sentence("{key}: refers to itself"),
    ),
    (
        r"Unsupported interpolation type (?P<name>\S+)\s+full_key: (?P<key>\S+)",
        _sentence("{key}: ${{{name}:...}} calls a function that does not exist"),
    ),
    (
        r"raised while resolving interpolation: \"?(?P<why>[^\n\"]+)\"?\s+full_key: (?P<key>\S+)",
        _interpolation_error,
    ),
    (
        r"(?:viable alternative|mismatched input|token recognition|extraneous|missing)[^\n]*"
        r"\s+full_key: (?P<key>\S+)",
        _sentence(
            "{key}: ${{ begins a reference to another setting, such as ${{seed}}; "
            "the characters themselves are written \\${{"
        ),
    ),
    (
        r"In '(?P<file>[^']+)': \w+ raised while composing config:\s+(?P<why>[^\n]+)",
        _error_in_file,
    ),
]
