"""From a cell's configuration to its objects: config -> problem, filter, controller."""

import dataclasses
import functools
from collections.abc import Callable
from importlib import import_module
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..problem import Controller, Filter, Problem
from ..pytree import is_struct
from ..settings import ConfigError, unknown_key
from ..simulate import simulate_trial


class Experiment(NamedTuple):
    """The objects of one cell."""

    problem: Problem
    filter: Filter
    controller: Controller


def build(config: dict[str, Any]) -> Experiment:
    """Make the objects a configuration describes; raises `ConfigError`."""
    made = {group: _make(config[group], group) for group in ("system", "cost", "filter", "controller")}
    parts = {"system": made["system"], "cost": made["cost"]}
    return Experiment(_make(config["problem"], "problem", parts), made["filter"], made["controller"])


def _make(node: Any, path: str, parts: dict[str, Any] | None = None) -> Any:
    """A dict with `_target_` becomes that object, its values made first; anything else stays as it is."""
    if isinstance(node, list):
        return [_make(item, path) for item in node]
    if not isinstance(node, dict):
        return node
    values = {key: _make(value, f"{path}.{key}") for key, value in node.items() if key != "_target_"}
    if "_target_" not in node:
        return values
    target = _locate(node["_target_"], path)
    known = [field.name for field in dataclasses.fields(target)]
    for key in values:
        if key not in known:
            raise ConfigError(unknown_key(f"{path}.{key}", [f"{path}.{name}" for name in known]))
    try:
        return target(**values, **(parts or {}))
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}.{error}") from error


def _locate(name: Any, path: str) -> Any:
    module, _, attribute = str(name).rpartition(".")
    try:
        target = getattr(import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise ConfigError(f"{path}._target_={name}: {error}") from error
    if not (isinstance(target, type) and is_struct(target)):
        raise ConfigError(f"{path}._target_={name}: must name a class made with mppi_belief.struct")
    return target


def check(config: dict[str, Any]) -> None:
    """Build everything and trace one trial without running it; raises `ConfigError` with one line."""
    parts = build(config)
    _check_fit(parts.problem)
    leaves, shape = jax.tree.flatten(parts)
    _check_shapes(shape, tuple(np.shape(leaf) for leaf in leaves), config["precision"])


def _check_fit(problem: Problem) -> None:
    """Every function of the system and the cost takes a state of the prior's size and returns what it should."""
    system, cost = problem.system, problem.cost
    nx, x = len(problem.prior_mean), jnp.asarray(problem.prior_mean)
    _shape("prior_std", lambda x: jnp.asarray(problem.prior_std), x, (nx,))
    _shape("cost.goal", lambda x: jnp.asarray(cost.goal), x, (nx,))
    nu = _shape("cost.R", lambda x: cost.R, x)[0]
    _shape("cost.R", lambda x: cost.R, x, (nu, nu))
    _shape("system.f", lambda x: system.f(x), x, (nx,))
    _shape("system.G", lambda x: system.G(x), x, (nx, nu))
    nw = _shape("system.H", lambda x: system.H, x)[-1]
    _shape("system.H", lambda x: system.H, x, (nx, nw))
    ny = _shape("system.c", lambda x: system.c(x), x)[0]
    _shape("system.c", lambda x: system.c(x), x, (ny,))
    _shape("system.sigma_o", lambda x: system.sigma_o(x), x, (ny, ny))
    _shape("system.clearance", lambda x: system.clearance(x), x, ())
    _shape("cost.base", lambda x: cost.base(x), x, ())
    _shape("cost.penalty", lambda x: cost.penalty(x), x, ())
    _shape("cost.terminal", lambda x: cost.terminal(x), x, ())


def _shape(
    name: str, function: Callable[[Array], Array], x: Array, wanted: tuple[int, ...] | None = None
) -> tuple[int, ...]:
    """The shape that `function` returns for a state x; raises `ConfigError` if it fails or is not the one wanted."""
    try:
        got: tuple[int, ...] = jax.eval_shape(function, x).shape
    except Exception as error:
        raise ConfigError(f"{name} fails for a state of shape {x.shape}: {_first_line(error)}") from error
    if wanted is not None and got != wanted:
        raise ConfigError(f"{name} has shape {got}, must be {wanted} for a state of shape {x.shape}")
    return got or (1,)


def _first_line(error: Exception) -> str:
    return next(iter(str(error).strip().splitlines()), type(error).__name__)


@functools.cache
def _check_shapes(structure: Any, shapes: tuple[tuple[int, ...], ...], precision: str) -> None:
    """Trace a trial of this structure: a sweep over numbers needs it once."""
    with jax.enable_x64(precision == "float64"):
        parts = jax.tree.unflatten(structure, [jax.ShapeDtypeStruct(shape, float) for shape in shapes])
        try:
            jax.eval_shape(simulate_trial, *parts, 0, 0)
        except Exception as error:
            raise ConfigError(f"filter or controller does not fit the problem: {_first_line(error)}") from error
