"""The settings of a command: types and ranges of the top level of a configuration.

OmegaConf checks the types while it composes, `check_settings` the ranges afterwards. Groups
(system, cost, ...) are checked where their objects are built. Imports no JAX, so that a wrong
setting is reported before anything slow is loaded.
"""

import math
from dataclasses import dataclass, field, fields
from typing import Any

from omegaconf import MISSING

from ..errors import ConfigError, unknown_key
from ..fields import Choice, Number, WholeNumber, checked, ruled, rules
from .executors import folders_of, read_executor
from .folders import FolderName

# Settings that do not change what a trial is.
RUNTIME_KEYS = (
    "n_trials",
    "workers",
    "results_dir",
    "report_dir",
    "verify_dir",
    "record",
    "executor",
    "shard",
    "trial_timeout",
)
# Texts that describe a study in its report; they make no difference to a cell.
DESCRIPTION_KEYS = ("title", "question")
DEFAULT_BATCH = {"cpu": 1, "gpu": 200}  # trials; a GPU advances the 200 trials of Sec. VII together
MOST_TRIALS = 10**7
LARGEST_WHOLE_NUMBER = 10**300  # of a whole number; larger ones are no float


@dataclass
class Planner:
    """Holds what all sampling planners share; the ranges are those of the planners' own fields."""

    n_samples: int = MISSING
    horizon: int = MISSING
    temperature: float = MISSING
    control_std: float | None = MISSING
    at_step_end: bool = MISSING
    variance_of: str = MISSING
    expectation: str = MISSING
    variance: str = MISSING
    sigma_point_spread: float = MISSING


@dataclass
class Settings:
    """Holds the top level of conf/config.yaml, which explains each setting and its default."""

    theta: float = ruled(Number(ge=0), MISSING)
    w_obs: float = ruled(Number(ge=0), MISSING)
    seed: int = ruled(WholeNumber(ge=0, le=2**31 - 1), MISSING)
    n_trials: int = ruled(WholeNumber(ge=1, le=MOST_TRIALS), MISSING)
    workers: int = ruled(WholeNumber(ge=1, le=1024), MISSING)
    platform: str = ruled(Choice(tuple(DEFAULT_BATCH)), MISSING)
    batch: int | None = ruled(WholeNumber(ge=1, le=10**5, optional=True), None)
    trial_timeout: float | None = ruled(Number(ge=1e-3, le=1e9, optional=True), None)  # s
    shard: str | None = None
    precision: str = ruled(Choice(("float32", "float64")), MISSING)
    results_dir: str = ruled(FolderName(), MISSING)
    report_dir: str = ruled(FolderName(), MISSING)
    verify_dir: str = ruled(FolderName(), MISSING)
    record: int | None = ruled(WholeNumber(ge=0, le=MOST_TRIALS, optional=True), None)
    title: str | None = None
    question: str | None = None
    planner: Planner = field(default=MISSING)
    problem: dict[str, Any] = field(default=MISSING)
    system: dict[str, Any] = field(default=MISSING)
    cost: dict[str, Any] = field(default=MISSING)
    filter: dict[str, Any] = field(default=MISSING)
    controller: dict[str, Any] = field(default=MISSING)
    executor: dict[str, Any] = field(default=MISSING)


def batch_size(config: dict[str, Any]) -> int | None:
    """Returns how many trials advance together: `batch`, or the default of the platform."""
    return config["batch"] if config["batch"] is not None else DEFAULT_BATCH.get(config["platform"])


def check_settings(config: dict[str, Any]) -> None:
    """Raises `ConfigError` for an unknown key, a setting out of range, or a value that no setting
    can have; puts home folders in place of `~`.
    """
    _check_keys(config, [setting.name for setting in fields(Settings)])
    _check_keys(config["planner"], [setting.name for setting in fields(Planner)], "planner.")
    for name, rule in rules(Settings).items():
        try:
            value = checked(name, config[name], rule)
        except ValueError as error:
            raise ConfigError(str(error)) from None
        if isinstance(rule, FolderName):
            config[name] = value
    _check_plain_values(config, "")
    config["executor"] |= folders_of(read_executor(config["executor"]))


def _check_keys(node: Any, known: list[str], prefix: str = "") -> None:
    """Raises `ConfigError` for a key that is not among the known ones."""
    names = [f"{prefix}{name}" for name in known]
    for key in node:
        if f"{prefix}{key}" not in names:
            raise ConfigError(unknown_key(f"{prefix}{key}", names))


def _check_plain_values(node: Any, path: str) -> None:
    """Raises `ConfigError` for a value that is no text, true or false, null or finite number.

    A yaml file can also hold bytes, dates and paths.
    """
    if isinstance(node, dict):
        for key, value in node.items():
            if not isinstance(key, str):
                raise ConfigError(f"{path}: a key must be a word, got {key!r}")
            _check_plain_values(value, f"{path}.{key}" if path else key)
    elif isinstance(node, list):
        for value in node:
            _check_plain_values(value, path)
    elif isinstance(node, int) and abs(node) > LARGEST_WHOLE_NUMBER:
        raise ConfigError(f"{path} must be at most {LARGEST_WHOLE_NUMBER:g}")
    elif isinstance(node, float) and not math.isfinite(node):
        raise ConfigError(f"{path} must be finite, got {node}")
    elif not isinstance(node, bool | int | float | str | None):
        raise ConfigError(f"{path} must be a number, a word, a list or a mapping, got {node!r}")
