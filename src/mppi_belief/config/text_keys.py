"""Which settings are texts: their values are taken as they are written.

    texts    results_dir, executor.partition    the value as it is, commas included
    choices  precision                          a word as it is; on the command line commas sweep

All other settings are numbers, lists and mappings, or names of options.
"""

from collections.abc import Iterator
from dataclasses import fields
from typing import Any, get_type_hints

from ..fields import Choice, rules
from .executors import KINDS
from .settings import Settings


def _keys_of_type(cls: Any, prefix: str, *types: Any) -> Iterator[str]:
    """Yields the dotted keys of a dataclass's fields that have one of some types."""
    hints = get_type_hints(cls)
    for field in fields(cls):
        if hints[field.name] in types:
            yield f"{prefix}{field.name}"


def _all_keys_of_type(*types: Any) -> frozenset[str]:
    """Returns the keys of the settings and of all executors that have one of some types."""
    keys = set(_keys_of_type(Settings, "", *types))
    for executor in KINDS.values():
        keys |= set(_keys_of_type(executor, "executor.", *types))
    return frozenset(keys)


CHOICES = frozenset(name for name, rule in rules(Settings).items() if isinstance(rule, Choice))
TEXTS = _all_keys_of_type(str, str | None) - CHOICES
OPTIONAL_TEXTS = _all_keys_of_type(str | None)
LISTS_OF_TEXTS = _all_keys_of_type(list[str])
