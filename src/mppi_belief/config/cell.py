"""The identity of a cell: which settings make two cells the same, and how it is labelled."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

ALGORITHM_VERSION = 4  # raise when the same configuration would give other numbers

# The keys of a configuration that make a cell's numbers: what it is built from, and how it is
# computed.
IDENTITY = (
    "system",
    "cost",
    "problem",
    "filter",
    "controller",
    "code",
    "names",
    "seed",
    "precision",
    "platform",
    "batch",
)


class Cell(NamedTuple):
    """Represents one complete configuration, of which many trials are run."""

    config: dict[str, Any]  # as `config.compose.collect` returns it

    @property
    def id(self) -> str:
        """Returns the controller and a hash of everything that determines a trial's numbers."""
        identity = canonical(
            {key: self.config[key] for key in IDENTITY} | {"algorithm": ALGORITHM_VERSION}
        )
        text = json.dumps(identity, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return (
            f"{self.config['names']['controller']}-{hashlib.sha256(text.encode()).hexdigest()[:12]}"
        )


def batches(trials: Sequence[int], size: int) -> Iterator[tuple[int, ...]]:
    """Yields trials, which are in ascending order, as batches.

    The trials of a batch have the same trial // size, so each trial has the same batch and the same
    place in it whichever others are missing.
    """
    for _, batch in itertools.groupby(trials, lambda trial: trial // size):
        yield tuple(batch)


def labels(config: dict[str, Any]) -> dict[str, Any]:
    """Returns the labels of a cell in rows, tables and titles, by column.

    They are controller, theta, w_obs, seed and all settings that were given. A number that the cell
    does not have is NaN.
    """
    controller = config["controller"]
    path_cost = controller.get("path_cost")
    theta_owner = path_cost if isinstance(path_cost, dict) else controller
    always = {
        "controller": config["names"]["controller"],
        "theta": theta_owner.get("theta", math.nan),
        "w_obs": config["cost"].get("w_obs", math.nan),
        "seed": config["seed"],
    }
    return always | {name: value for name, value in config["swept"].items() if name not in always}


def canonical(node: Any) -> Any:
    """Returns a configuration with whole floats as int, so that 0.0 and 0 make the same cell."""
    if isinstance(node, dict):
        return {key: canonical(value) for key, value in node.items()}
    if isinstance(node, list):
        return [canonical(value) for value in node]
    return int(node) if isinstance(node, float) and node.is_integer() else node
