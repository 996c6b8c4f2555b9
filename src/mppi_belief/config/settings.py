"""The types and ranges of a configuration, and the checks that YAML alone cannot make.

Uses OmegaConf's structured configs but no JAX, so that a wrong key is told before anything is loaded.
"""

import math
from dataclasses import dataclass, field, fields
from typing import Any

from omegaconf import MISSING

from ..errors import ConfigError, unknown_key

DEFAULT_BATCH = {"cpu": 1, "gpu": 200}  # a GPU takes the 200 trials of Sec. VII at once


MOST = 10**300  # of a whole number; more is no float


def _ranged(low: float, high: float = math.inf) -> Any:
    return field(default=MISSING, metadata={"range": (low, high)})


@dataclass
class Planner:
    """What all sampling planners share."""

    n_samples: int = MISSING
    horizon: int = MISSING
    temperature: float = MISSING
    control_std: float | None = MISSING


@dataclass
class Settings:
    """The top level of conf/config.yaml; groups are checked where they are built."""

    theta: float = _ranged(0)
    w_obs: float = _ranged(0)
    seed: int = _ranged(0, 2**31 - 1)
    n_trials: int = _ranged(1, 10**7)
    workers: int = _ranged(1, 1024)
    platform: str = field(default=MISSING, metadata={"options": tuple(DEFAULT_BATCH)})
    batch: int | None = field(default=None, metadata={"range": (1, 10**5)})
    trial_timeout: float | None = field(default=None, metadata={"range": (1e-3, 1e9)})
    shard: str | None = None
    precision: str = field(default=MISSING, metadata={"options": ("float32", "float64")})
    results_dir: str = MISSING
    report_dir: str = MISSING
    verify_dir: str = MISSING
    record: int | None = field(default=None, metadata={"range": (0, 10**7)})
    planner: Planner = MISSING
    problem: dict[str, Any] = MISSING
    system: dict[str, Any] = MISSING
    cost: dict[str, Any] = MISSING
    filter: dict[str, Any] = MISSING
    controller: dict[str, Any] = MISSING
    executor: dict[str, Any] = MISSING


def batch_size(config: dict[str, Any]) -> int | None:
    """How many trials advance together: `batch`, or what its platform takes by itself."""
    return config["batch"] if config["batch"] is not None else DEFAULT_BATCH.get(config["platform"])


def check(config: dict[str, Any]) -> None:
    """Raise `ConfigError` for an unknown key, a number out of range, and any number anywhere that is not finite."""
    known = [setting.name for setting in fields(Settings)]
    for key in config:
        if key not in known:
            raise ConfigError(unknown_key(key, known))
    shared = [f"planner.{setting.name}" for setting in fields(Planner)]
    for key in config["planner"]:
        if f"planner.{key}" not in shared:
            raise ConfigError(unknown_key(f"planner.{key}", shared))
    for setting in fields(Settings):
        value = config[setting.name]
        options = setting.metadata.get("options", (value,))
        if value not in options:
            raise ConfigError(f"{setting.name}={value}: must be one of {', '.join(options)}")
        low, high = setting.metadata.get("range", (-math.inf, math.inf))
        if isinstance(value, float) and not math.isfinite(value):
            raise ConfigError(f"{setting.name}={value}: must be finite")
        if isinstance(value, int | float) and not low <= value <= high:
            bound = f"at least {low}" if value < low else f"at most {high}"
            raise ConfigError(f"{setting.name}={value:g}: must be {bound}")
    for name in ("results_dir", "report_dir", "verify_dir"):
        if not config[name].strip() or "\0" in config[name]:
            raise ConfigError(f"{name}: must name a folder")
    _check_values(config, "")


def _check_values(node: Any, path: str) -> None:
    """Everything is a word, true or false, null, or a finite number; a yaml can also have bytes, dates and paths."""
    if isinstance(node, dict):
        for key, value in node.items():
            if not isinstance(key, str):
                raise ConfigError(f"{path}: a key must be a word, got {key!r}")
            _check_values(value, f"{path}.{key}" if path else key)
    elif isinstance(node, list):
        for value in node:
            _check_values(value, path)
    elif isinstance(node, int) and abs(node) > MOST:
        raise ConfigError(f"{path}: must be at most {MOST:g}")
    elif isinstance(node, float) and not math.isfinite(node):
        raise ConfigError(f"{path}={node}: must be finite")
    elif not isinstance(node, bool | int | float | str | None):
        raise ConfigError(f"{path}={node!r}: must be a number, a word, a list or a mapping")
