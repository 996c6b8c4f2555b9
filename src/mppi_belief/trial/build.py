"""Makes a cell's objects from its configuration: problem, filter, controller."""

import functools
import warnings
from typing import Any, NamedTuple

import jax
import numpy as np

from ..belief.integration import ManyNodesWarning
from ..config.targets import locate
from ..errors import ConfigError, FieldError, unknown_key
from ..numerics.jax_settings import pin_jax_settings
from ..planning.parts import ChecksFit
from ..problem import Controller, Filter, Problem
from ..simulate import simulate_trial
from ..structs import is_struct, struct_fields
from .derivatives import derivative_notes
from .traced_fields import reason_of
from .validate import check_numbers, check_problem, checked_states


class CellParts(NamedTuple):
    """Holds the objects of one cell."""

    problem: Problem
    filter: Filter
    controller: Controller


def build(config: dict[str, Any]) -> CellParts:
    """Makes the objects that a configuration describes; raises `ConfigError`.

    A module that is imported for this keeps no settings of JAX that it has changed.
    """
    pin_jax_settings()
    system = _make_group(config, "system")
    cost = _make_group(config, "cost")
    filter = _make_group(config, "filter")
    controller = _make_group(config, "controller")
    problem = _make_group(config, "problem", {"system": system, "cost": cost})
    if not isinstance(problem, Problem):
        raise ConfigError("problem._target_: must be mppi_belief.Problem")
    pin_jax_settings()
    return CellParts(problem, filter, controller)


def check(config: dict[str, Any]) -> list[str]:
    """Checks that a configuration can be run, without running a trial; raises `ConfigError`.

    Everything is built, computed at a few states, and one trial is traced. Returns lines about what
    can be run and is worth knowing: derivatives that are missing, expectations that are slow.
    """
    parts = build(config)
    precision = config["precision"]
    with jax.enable_x64(precision == "float64"):
        check_numbers(parts, precision)
        check_problem(parts.problem, precision)
        _check_fit(parts.problem, parts.controller)
        leaves, structure = jax.tree.flatten(parts)
        slow = _check_trial(structure, tuple(np.shape(leaf) for leaf in leaves), precision)
        states = checked_states(parts.problem).astype(precision)
        return [*slow, *derivative_notes(parts.problem, parts.controller, states)]


def _make_group(config: dict[str, Any], group: str, parts: dict[str, Any] | None = None) -> Any:
    """Makes the object of one group of a configuration, from its node and from `parts`."""
    if "_target_" not in config[group]:
        raise ConfigError(f"{group} has no _target_, the class it is made of")
    return _make(config[group], group, parts)


def _make(node: Any, path: str, parts: dict[str, Any] | None = None) -> Any:
    """Makes an object of every mapping with a `_target_`, from the inside out."""
    if isinstance(node, list):
        return [_make(item, path) for item in node]
    if not isinstance(node, dict):
        return node
    settings = {key: value for key, value in node.items() if key != "_target_"}
    values = {key: _make(value, f"{path}.{key}") for key, value in settings.items()}
    if "_target_" not in node:
        return values
    target = locate(node["_target_"], path)
    if not (isinstance(target, type) and is_struct(target)):
        raise ConfigError(
            f"{path}._target_={node['_target_']}: must name a class made with mppi_belief.struct"
        )
    known = [f"{path}.{field.name}" for field in struct_fields(target)]
    for key in values:
        if f"{path}.{key}" not in known:
            raise ConfigError(unknown_key(f"{path}.{key}", known))
    try:
        return target(**values, **(parts or {}))
    except (TypeError, ValueError, OverflowError) as error:
        message = f"{path}.{error}"
        key = message.partition(" ")[0]
        if key in known:
            raise FieldError(key, message.removeprefix(key)) from error
        raise ConfigError(message) from error


def _check_fit(problem: Problem, controller: Controller) -> None:
    """Raises `ConfigError` where the controller or one of its parts does not fit the problem."""
    parts = {"controller": controller}
    parts |= {f"controller.{name}": part for name, part in vars(controller).items()}
    for path, part in parts.items():
        if isinstance(part, ChecksFit):
            try:
                part.check_fit(problem)
            except ValueError as error:
                key, _, reason = str(error).partition(" ")
                raise FieldError(f"{path}.{key}", f" {reason}") from error


@functools.cache
def _check_trial(
    structure: Any, shapes: tuple[tuple[int, ...], ...], precision: str
) -> tuple[str, ...]:
    """Traces a trial of this structure, in the current precision and once for all numbers.

    Returns a line for every function of the cost whose expectation takes many evaluations.
    """
    parts = jax.tree.unflatten(structure, [jax.ShapeDtypeStruct(shape, float) for shape in shapes])
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", ManyNodesWarning)
            jax.eval_shape(simulate_trial, *parts, 0, 0)
    except Exception as error:
        reason = reason_of(error, parts.controller, parts.filter, parts.problem)
        raise ConfigError(f"filter or controller does not fit the problem: {reason}") from error
    messages = []
    for each in caught:
        if each.category is ManyNodesWarning:
            messages.append(str(each.message))
        else:
            warnings.showwarning(each.message, each.category, each.filename, each.lineno)
    return tuple(dict.fromkeys(messages))
