"""The jobs of a command line: one list of overrides for each configuration that is to be composed.

Hydra's public API composes one configuration at a time; it has no function that lists the jobs of a
sweep. This module does, with the parser of overrides that Hydra offers to sweeper plugins
(`hydra.core.override_parser`). It takes nothing from `hydra._internal`, and it is the only module
that needs more of Hydra than its documented functions.
"""

import itertools
import math
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from ..errors import ConfigError
from .conf_files import groups
from .hydra_words import quoted, word_for_hydra
from .misspelt_keys import unknown_key_line
from .request import key_of

MOST_JOBS = 10_000  # of a sweep; more is a mistake
HYDRA_KEY = re.compile(r"[A-Za-z0-9_$.@/:-]*")  # with its group's package


class SweptChoice(NamedTuple):
    """Holds the overrides that one word makes: one, or several where it sweeps over a key."""

    word: str  # as typed, or as a yaml file has it: theta=0,1
    overrides: list[str]  # theta=0 and theta=1


def choices_of(
    overrides: Sequence[str], folders: Sequence[str], swept: Mapping[str, Any] | None = None
) -> list[SweptChoice]:
    """Returns the choices that overrides and the sweep of a yaml file leave.

    `folders` are those of `--config-dir`. `swept` maps keys to the values that a yaml file sweeps,
    in the notation of a command line ("0,1,2"); an override of the same key replaces them. Raises
    `ConfigError` for a word that is no override, and for a sweep that is empty, continuous or too
    long.
    """
    from hydra.core.global_hydra import GlobalHydra
    from hydra.core.override_parser.overrides_parser import OverridesParser

    parser = OverridesParser.create(config_loader=GlobalHydra.instance().config_loader())
    group_names = list(groups(folders))
    words = [f"{key}={values}" for key, values in (swept or {}).items()]
    choices: dict[str, SweptChoice] = {}
    for word in [*words, *overrides]:
        for_hydra = word_for_hydra(word, group_names)
        try:
            (override,) = parser.parse_overrides([for_hydra])
        except Exception as error:  # of Hydra's grammar, or of a function that a value calls
            raise ConfigError(_unreadable(word, error, folders)) from error
        values = _swept_overrides(override, word) if override.is_sweep_override() else [for_hydra]
        choices[override.get_key_element()] = SweptChoice(word, values)
    return list(choices.values())


def _unreadable(word: str, error: Exception, folders: Sequence[str]) -> str:
    """Returns one line about a word that Hydra's grammar refuses, with the way to write a text."""
    head, _, value = word.partition("=")
    key = key_of(word)
    if not HYDRA_KEY.fullmatch(key):
        return unknown_key_line(key, folders)
    for line in str(error).splitlines():
        if "while evaluating" in line and "Unknown function" not in line:
            return f"{word}: {line}"
    text = shlex.quote(f"{head}={quoted(value, double=True)}")
    return f"{word}: is no number, list, mapping or plain word; a text is given as {text}"


def first(choices: Sequence[SweptChoice]) -> list[str]:
    """Returns the overrides of the first job of a sweep."""
    return [choice.overrides[0] for choice in choices]


def product(choices: Sequence[SweptChoice]) -> Iterator[list[str]]:
    """Yields the overrides of each job: all combinations. Raises `ConfigError` if there are too
    many.
    """
    if math.prod(len(choice.overrides) for choice in choices) > MOST_JOBS:
        raise ConfigError(f"a sweep of more than {MOST_JOBS} settings")
    return map(list, itertools.product(*(choice.overrides for choice in choices)))


def _swept_overrides(override: Any, line: str) -> list[str]:
    """Returns the overrides that the values of a swept key make; `line` is the word as typed."""
    if override.is_hydra_override():
        raise ConfigError(f"{line}: a key of Hydra cannot be swept")
    if not override.is_discrete_sweep() or _is_long(override.value()):
        raise ConfigError(f"{line}: a sweep takes a list of at most {MOST_JOBS} values")
    key = override.get_key_element()
    values = [f"{key}={value}" for value in override.sweep_string_iterator()]
    if not values:
        raise ConfigError(f"{line}: no value to sweep over")
    return values


def _is_long(sweep: Any) -> bool:
    """Returns whether a range has too many values; they are counted, not listed."""
    if not hasattr(sweep, "step"):
        return False
    if not sweep.step:
        return True
    count = (sweep.stop - sweep.start) / sweep.step
    return not count <= MOST_JOBS  # also true where the count is no number
