"""A person's mistake in one line: what Hydra and OmegaConf raise, said plainly."""

import re
from collections.abc import Iterator
from dataclasses import fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from ..errors import ConfigError, first_line, unknown_key
from .settings import Settings


def one_line(error: BaseException, conf: Path) -> str:
    """What is wrong, in one line; `conf` is the folder with the config groups."""
    chain = list(_causes(error))
    told = [str(cause) for cause in chain if isinstance(cause, ConfigError)]
    if told:
        return told[0]
    if any(isinstance(cause, RecursionError) for cause in chain):
        return "nested too deeply, or something that contains itself"
    text = "\n".join(map(str, chain))  # the messages of all, outermost first
    for pattern, say in _RULES:
        found = re.search(pattern, text, re.DOTALL)
        if found:
            return say(found, conf)
    return first_line(text) or type(error).__name__


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    """An exception and what it comes from."""
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def _unknown_key(found: re.Match[str], conf: Path) -> str:
    key = found["key"].strip("'\"+~")
    parent = key.rpartition(".")[0]
    known = _known_keys(parent, conf)
    if key in known:
        return f"'{key}' is a key of another {parent.partition('.')[0]} than the one chosen; see mppi-belief run --cfg job"
    return unknown_key(key, known)


def _known_keys(parent: str, conf: Path) -> list[str]:
    """Keys and groups of the top level, or what the files under `conf` have below `parent`."""
    if not parent:
        groups = [entry.name for entry in conf.iterdir() if entry.is_dir()]
        return [*(setting.name for setting in fields(Settings)), *groups]
    keys: set[str] = set()
    for path in conf.rglob("*.yaml"):
        node: Any = OmegaConf.to_container(OmegaConf.load(path), resolve=False)
        package = path.parent.name
        if parent.split(".")[0] == package and not (isinstance(node, dict) and package in node):
            node = {package: node}  # a file of its group's package, not of the global one
        for part in parent.split("."):
            node = node.get(part) if isinstance(node, dict) else None
        keys |= {f"{parent}.{key}" for key in node} if isinstance(node, dict) else set()
    return sorted(keys)


def _ambiguous(found: re.Match[str], conf: Path) -> str:
    return f"{found['override']}: several values; add -m to sweep over them"


def _unknown_option(found: re.Match[str], conf: Path) -> str:
    group, _, option = found["choice"].rpartition("/")
    options = [line.strip() for line in found["options"].splitlines() if line.strip()]
    near = get_close_matches(option, options, n=1)
    guess = f"; did you mean '{near[0]}'?" if near else ""
    return f"{group}={option}: no such option, choose from {', '.join(options)}{guess}"


def _bad_value(found: re.Match[str], conf: Path) -> str:
    wanted = {"Float": "a number", "Integer": "a whole number", "Boolean": "true or false"}
    return f"{found['key']}={found['value']}: must be {wanted.get(found['type'], found['type'])}"


def _inside(found: re.Match[str], conf: Path) -> str:
    return f"{found['file']}.yaml: {found['why'].strip()}"


_RULES = [
    (
        r"Could not find '(?P<choice>[^']+)'\s+Available options in '[^']+':\s+(?P<options>[^\n]+(?:\n\t[^\n]+)*)",
        _unknown_option,
    ),
    (r"Ambiguous value for argument '(?P<override>[^']+)'", _ambiguous),
    (r"Could not override '(?P<key>[^']+)'.*is not in struct", _unknown_key),
    (r"Key '[^']+' (?:is not in struct|not in '[^']+')\s+full_key: (?P<key>\S+)", _unknown_key),
    (
        r"Could not override '(?P<key>[^'=@]+)(?:@[^']*)?'\.?\s*(?:No match in|Did you mean)",
        _unknown_key,
    ),
    (
        r"Value '(?P<value>[^']*)'.*?could not be converted to (?P<type>\w+)\s+full_key: (?P<key>\S+)",
        _bad_value,
    ),
    (r"In '(?P<file>[^']+)': \w+ raised while composing config:\s+(?P<why>[^\n]+)", _inside),
]
