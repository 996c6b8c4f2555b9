"""From a cell's configuration to its objects: config -> problem, filter, controller."""

import dataclasses
import functools
from typing import Any, NamedTuple

import jax
import numpy as np

from ..config.targets import locate
from ..errors import ConfigError, first_line, unknown_key
from ..problem import Controller, Filter, Problem
from ..simulate import simulate_trial
from ..structs import is_struct
from .validate import check_numbers, check_problem


class Experiment(NamedTuple):
    """The objects of one cell."""

    problem: Problem
    filter: Filter
    controller: Controller


def build(config: dict[str, Any]) -> Experiment:
    """Make the objects a configuration describes; raises `ConfigError`."""
    made = {group: _part(config, group) for group in ("system", "cost", "filter", "controller")}
    problem = _part(config, "problem", {"system": made["system"], "cost": made["cost"]})
    if not isinstance(problem, Problem):
        raise ConfigError("problem._target_: must be mppi_belief.Problem")
    return Experiment(problem, made["filter"], made["controller"])


def _part(config: dict[str, Any], group: str, parts: dict[str, Any] | None = None) -> Any:
    if "_target_" not in config[group]:
        raise ConfigError(f"{group} has no _target_, the class it is made of")
    return _make(config[group], group, parts)


def _make(node: Any, path: str, parts: dict[str, Any] | None = None) -> Any:
    """A dict with `_target_` becomes that object, its values made first; anything else stays as it is."""
    if isinstance(node, list):
        return [_make(item, path) for item in node]
    if not isinstance(node, dict):
        return node
    values = {
        key: _make(value, f"{path}.{key}") for key, value in node.items() if key != "_target_"
    }
    if "_target_" not in node:
        return values
    target = locate(node["_target_"], path)
    if not (isinstance(target, type) and is_struct(target)):
        raise ConfigError(
            f"{path}._target_={node['_target_']}: must name a class made with mppi_belief.struct"
        )
    known = [field.name for field in dataclasses.fields(target)]
    for key in values:
        if key not in known:
            raise ConfigError(unknown_key(f"{path}.{key}", [f"{path}.{name}" for name in known]))
    try:
        return target(**values, **(parts or {}))
    except (TypeError, ValueError, OverflowError) as error:
        raise ConfigError(f"{path}.{error}") from error


def check(config: dict[str, Any]) -> None:
    """Build everything, compute it at a few states, trace one trial without running it; raises `ConfigError`."""
    parts, precision = build(config), config["precision"]
    with jax.enable_x64(precision == "float64"):
        check_numbers(parts, precision)
        check_problem(parts.problem, precision)
        leaves, structure = jax.tree.flatten(parts)
        _check_trial(structure, tuple(np.shape(leaf) for leaf in leaves), precision)


@functools.cache
def _check_trial(structure: Any, shapes: tuple[tuple[int, ...], ...], precision: str) -> None:
    """Trace a trial of this structure in the current precision: a sweep over numbers needs it once."""
    parts = jax.tree.unflatten(structure, [jax.ShapeDtypeStruct(shape, float) for shape in shapes])
    try:
        jax.eval_shape(simulate_trial, *parts, 0, 0)
    except Exception as error:
        raise ConfigError(
            f"filter or controller does not fit the problem: {first_line(error)}"
        ) from error
