"""Compares the settings of cells with those of other studies, first of all the paper's Table I.

Two cells have the same settings where system, cost, problem, filter and controller are equal, the
planner's settings included. The seed, the number of trials and how they are computed (platform,
precision, batch) do not count: they change a Monte Carlo estimate but not what it estimates.
"""

from collections.abc import Iterator, Sequence
from typing import Any

from ..config.cell import canonical

SETTING_GROUPS = ("system", "cost", "problem", "filter", "controller")
ABSENT = object()  # stands for a key that one configuration lacks

Configuration = dict[str, Any]  # of a cell, as `config.compose.collect` returns it


def departures(config: Configuration, reference: Configuration) -> tuple[str, ...]:
    """Returns the dotted keys in which a configuration differs from a reference, sorted."""
    ours = dict(_settings(config))
    theirs = dict(_settings(reference))
    keys = sorted(ours.keys() | theirs.keys())
    return tuple(key for key in keys if ours.get(key, ABSENT) != theirs.get(key, ABSENT))


def table_1_departures(
    config: Configuration, table_1: Sequence[Configuration]
) -> tuple[str, ...] | None:
    """Returns the departures from the cell of Table I that has the same controller.

    None where Table I, given as its configurations, has no such controller.
    """
    method = config["names"]["controller"]
    for reference in table_1:
        if reference["names"]["controller"] == method:
            return departures(config, reference)
    return None


def are_part_of(configs: Sequence[Configuration], study: Sequence[Configuration]) -> bool:
    """Returns whether every configuration has the settings of one of the study's."""
    return all(any(not departures(config, cell) for cell in study) for config in configs)


def _settings(config: Configuration) -> Iterator[tuple[str, Any]]:
    """Yields every setting that counts: its dotted key and its value."""
    for group in SETTING_GROUPS:
        yield from _leaves(canonical(config[group]), group)


def _leaves(node: Any, key: str) -> Iterator[tuple[str, Any]]:
    """Yields the dotted keys and values below a node; an empty dictionary is a value."""
    if isinstance(node, dict) and node:
        for name, value in node.items():
            yield from _leaves(value, f"{key}.{name}")
    else:
        yield key, node
