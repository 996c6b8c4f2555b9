"""Names a cell by the options that it was composed from and the settings that were given."""

import json
import re
from collections.abc import Sequence
from typing import Any

from ..errors import ConfigError
from .request import key_of
from .settings import DESCRIPTION_KEYS, RUNTIME_KEYS, batch_size

NAMED_GROUPS = ("system", "cost", "filter", "controller")  # their options name a cell


def cell_labels(
    overrides: Sequence[str], options: dict[str, str | None], config: dict[str, Any]
) -> dict[str, Any]:
    """Returns `names` (an option per group), `swept` (settings by key) and `batch` (trials)."""
    names = _option_names(options, config)
    keys = [key_of(override) for override in overrides]
    no_label = (*RUNTIME_KEYS, *DESCRIPTION_KEYS, "sweep", "experiment", "hydra")
    swept = {
        label_of(key): names.get(key) or options.get(key) or _scalar(config, key)
        for key in keys
        if key.split(".")[0] not in no_label
    }
    return {"names": names, "swept": swept, "batch": batch_size(config)}


def label_of(key: str) -> str:
    """Returns the name of a swept key in rows and reports: `sampler` for `controller/sampler`."""
    return key.rpartition("/")[2]


def _option_names(options: dict[str, str | None], config: dict[str, Any]) -> dict[str, str]:
    """Returns the option of each group that names a cell. Raises `ConfigError` for one that is no
    file of its group.

    A system's file may give the cost itself, which then has the system's name.
    """
    for group, option in options.items():
        if option is not None and not re.fullmatch(r"\w[\w.-]*", str(option)):
            raise ConfigError(f"{group}={option}: an option is one word")
    chosen = dict(options)
    if chosen.get("cost") is None and config.get("cost"):
        chosen["cost"] = chosen.get("system")
    for group in NAMED_GROUPS:
        if chosen.get(group) is None:
            raise ConfigError(f"{group}: one must be chosen")
    return {group: str(chosen[group]) for group in NAMED_GROUPS}


def _scalar(config: dict[str, Any], key: str) -> Any:
    """Returns the value of a dotted key; lists and dicts as JSON, so that it fits a column."""
    value: Any = config
    for part in key.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return json.dumps(value) if isinstance(value, list | dict) else value
