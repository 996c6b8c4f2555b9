"""Says what a person probably meant by a key that the configuration does not have.

The candidates are the keys and groups of conf/ and of the folders of `--config-dir`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from ..errors import unknown_key
from .conf_files import conf_dir, groups
from .settings import Settings
from .yaml_files import read_yaml

SEE = "see mppi-belief run --cfg job"

# Keys that have been renamed to something that their spelling does not lead to.
REPLACEMENTS = {
    "controller.evaluate": "controller/path_cost=risk_sensitive or =certainty_equivalent",
    "controller.risk": "controller.path_cost.variance_of",
    "controller.charge": "controller.path_cost.at_step_end (of ilqg and lqg: "
    "controller.at_step_end)",
    "controller.combine": "controller/combination=average or =pooled",
    "controller.diffusion": "controller/sampler=nominal or =innovation",
    "controller.proposal": "controller/sampler=nominal or =laplace",
    "controller.plan_from": "controller.schedule.components",
    "controller.sees_state": "controller=oracle",
    "cost.bump_width": "cost.obstacle_penalty.width",
}


def unknown_key_line(key: str, folders: Sequence[str] = ()) -> str:
    """Returns one line about a key or a group that the composed configuration does not have.

    `key` is as typed, without signs: `controller.path_cost.thta` or `controller/samplr`. `folders`
    are those of `--config-dir`.
    """
    if key in REPLACEMENTS:
        return f"unknown key '{key}'; use {REPLACEMENTS[key]} instead"
    known_groups = list(groups(folders))
    if "/" in key:
        if key in known_groups:
            group = key.partition("/")[0]
            return f"the chosen {group} has no '{key}'; {SEE}"
        return unknown_key(key, known_groups)
    keys = _keys(folders)
    if key in keys:
        group = _group_of(key, known_groups)
        return f"'{key}' is a key of another {group} than the one chosen; {SEE}"
    return unknown_key(key, _candidates(key, keys | set(known_groups)))


def _candidates(key: str, keys: set[str]) -> list[str]:
    """Returns the keys among which the nearest spelling is to be found.

    A last name that is spelt right leads to the keys with that name (`controller.theta` to
    `controller.path_cost.theta`), one that is not to those near it in the same place, and a place
    that does not exist to all keys.
    """
    parent, _, name = key.rpartition(".")
    namesakes = [known for known in sorted(keys) if _name_of(known) == name]
    if namesakes and parent:
        return get_close_matches(key, namesakes, n=1, cutoff=0.0)
    siblings = {_name_of(known): known for known in sorted(keys) if _parent_of(known) == parent}
    if siblings:
        return [siblings[near] for near in get_close_matches(name, siblings, n=1)]
    return get_close_matches(key, sorted(keys), n=1, cutoff=0.8)


def _parent_of(key: str) -> str:
    return key.rpartition(".")[0]


def _name_of(key: str) -> str:
    return key.rpartition(".")[2]


def _group_of(key: str, known_groups: Sequence[str]) -> str:
    """Returns the innermost group that a key belongs to: `controller/sampler`."""
    group = _parent_of(key).replace(".", "/")
    while group not in known_groups and "/" in group:
        group = group.rpartition("/")[0]
    return group


def _keys(folders: Sequence[str]) -> set[str]:
    """Returns all keys at every depth: those of the settings and of the yaml files of all groups.

    Experiments and sweeps define no keys; they set those of other groups.
    """
    keys = {setting.name for setting in fields(Settings)}
    for folder in (conf_dir(), *map(Path, folders)):
        keys |= set(_paths(_content(folder / "config.yaml"), ""))
        for path in folder.glob("*/**/*.yaml"):
            group = path.parent.relative_to(folder)
            if group.parts[0] not in ("experiment", "sweep"):
                keys |= set(_paths(_at_top_level(group, _content(path)), ""))
    return keys


def _content(path: Path) -> dict[str, Any]:
    """Returns the settings of a yaml file; none if it cannot be read."""
    try:
        content = read_yaml(path)
    except Exception:  # the file may not be a yaml file at all, and the message is about another
        return {}
    return {key: value for key, value in content.items() if key not in ("defaults", "hydra")}


def _at_top_level(group: Path, content: dict[str, Any]) -> dict[str, Any]:
    """Returns the settings of a file below the keys of its group, unless it already has them."""
    if group.parts[0] in content:
        return content
    for name in reversed(group.parts):
        content = {name: content}
    return content


def _paths(node: Any, parent: str) -> Iterator[str]:
    """Yields the dotted keys of nested mappings."""
    if not isinstance(node, dict):
        return
    for name, value in node.items():
        if name != "_target_":
            path = f"{parent}.{name}" if parent else str(name)
            yield path
            yield from _paths(value, path)
