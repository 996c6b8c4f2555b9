"""The identity of a cell: which settings make two cells the same, and how it is labelled."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

ALGORITHM_VERSION = 3  # raise when the same configuration would give other numbers


IDENTITY = (
    *("system", "cost", "problem", "filter", "controller", "code"),  # what it is built from
    *("names", "seed", "precision", "platform", "batch"),
)


class Cell(NamedTuple):
    """One setting of everything, to be run for many trials; see `mppi_belief.trial` for the config."""

    config: dict[str, Any]

    @property
    def id(self) -> str:
        """Controller and hash: what makes two cells the same, whoever runs them, with how many trials or workers."""
        identity = canonical(
            {key: self.config[key] for key in IDENTITY} | {"algorithm": ALGORITHM_VERSION}
        )
        text = json.dumps(identity, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return (
            f"{self.config['names']['controller']}-{hashlib.sha256(text.encode()).hexdigest()[:12]}"
        )


def batches(trials: Sequence[int], size: int) -> Iterator[tuple[int, ...]]:
    """Trials in ascending order as batches: those of one have the same trial // size, so that each trial has its
    batch and its place in it whichever others are missing."""
    for _, together in itertools.groupby(trials, lambda trial: trial // size):
        yield tuple(together)


def labels(config: dict[str, Any]) -> dict[str, Any]:
    """What tells a cell from others, for rows, tables and titles: method, theta, w_obs, seed, all that was swept."""
    nothing = float("nan")
    controller = config["controller"]
    path_cost = controller.get("path_cost")
    found = {
        "controller": config["names"]["controller"],
        "theta": (path_cost if isinstance(path_cost, dict) else controller).get("theta", nothing),
        "w_obs": config["cost"].get("w_obs", nothing),
        "seed": config["seed"],
    }
    return found | {name: value for name, value in config["swept"].items() if name not in found}


def canonical(node: Any) -> Any:
    """A configuration as it is compared: a float that is a whole number is that number, so that 0.0 is 0."""
    if isinstance(node, dict):
        return {key: canonical(value) for key, value in node.items()}
    if isinstance(node, list):
        return [canonical(value) for value in node]
    return int(node) if isinstance(node, float) and node.is_integer() else node
