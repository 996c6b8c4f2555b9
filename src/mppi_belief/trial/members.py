"""The members that a problem's system, cost and obstacles must have, by name.

Messages give a member the name that its key has in a configuration: "system.f" is
`problem.system.f`.
"""

import inspect
from typing import Any

import jax.numpy as jnp
from jax import Array

from ..errors import ConfigError
from ..obstacles import ClosedFormClearance, ObstacleDistances
from ..problem import Problem

# Members by the name that messages give them, and their shapes: nx states, nu controls, nw noise
# channels, ny measurements, m modes of the prior. A size is fixed where it is met first.
SHAPES: dict[str, tuple[str, ...]] = {
    "problem.prior_mean": ("nx",),
    "problem.prior_std": ("nx",),
    "problem.prior_modes": ("m", "nx"),
    "problem.prior_weights": ("m",),
    "cost.goal": ("nx",),
    "cost.R": ("nu", "nu"),
    "system.f": ("nx",),
    "system.G": ("nx", "nu"),
    "system.H": ("nx", "nw"),
    "system.c": ("ny",),
    "system.sigma_o": ("ny", "ny"),
    "problem.obstacles.clearance": (),
    "problem.obstacles.segment_clearance": (),
    "problem.obstacles.distances": ("obstacles",),
    "cost.base": (),
    "cost.penalty": (),
    "cost.terminal": (),
}
CONSTANT = ("system.H", "cost.R", "cost.goal")  # properties, not functions of the state
# Arguments of the functions that take something else than a state.
ARGUMENTS = {
    "cost.penalty": "x, surroundings",
    "problem.obstacles.clearance": "position",
    "problem.obstacles.segment_clearance": "start, end",
    "problem.obstacles.distances": "position",
}
OPTIONAL = ("problem.prior_modes", "problem.prior_weights")


def member_names(problem: Problem) -> list[str]:
    """Returns the names in `SHAPES` that this problem has to have."""
    absent = [name for name in OPTIONAL if getattr(problem, name.rpartition(".")[2]) is None]
    if problem.obstacles is None:
        absent.append("problem.obstacles.clearance")
    if not isinstance(problem.obstacles, ClosedFormClearance):
        absent.append("problem.obstacles.segment_clearance")
    if not isinstance(problem.obstacles, ObstacleDistances):
        absent.append("problem.obstacles.distances")
    return [name for name in SHAPES if name not in absent]


def owner_of(problem: Problem, name: str) -> Any:
    """Returns the object whose member a name of `SHAPES` is."""
    parts = name.split(".")[:-1]
    owner: Any = problem
    for part in parts if parts[0] != "problem" else parts[1:]:
        owner = getattr(owner, part)
    return owner


def check_member(problem: Problem, name: str) -> None:
    """Raises `ConfigError` for a member that is missing or takes other arguments."""
    owner = owner_of(problem, name)
    member = inspect.getattr_static(owner, name.rpartition(".")[2], None)
    if member is None:
        raise ConfigError(f"{name} is missing: {type(owner).__name__} must have it")
    _check_kind(type(owner).__name__, name, member)
    if name == "cost.penalty" and inspect.isfunction(member):
        _check_takes_surroundings(member, name, ARGUMENTS[name])
        moments = inspect.getattr_static(owner, "running_moments", None)
        if inspect.isfunction(moments):
            _check_takes_surroundings(moments, "cost.running_moments", "mean, cov, surroundings")


def _check_kind(kind: str, name: str, member: Any) -> None:
    """Raises `ConfigError` for a method of the class `kind` in place of a property, and the other
    way round.
    """
    word = name.rpartition(".")[2]
    if name in CONSTANT:
        if inspect.isfunction(member):
            raise ConfigError(
                f"{name}: {kind}.{word} is a method, must be the same for all states: write "
                f"`@property` above it and `def {word}(self)`"
            )
    elif not name.startswith("problem.prior") and not callable(_function_of(member)):
        arguments = ARGUMENTS.get(name, "x")
        raise ConfigError(
            f"{name}: {kind}.{word} is no method, must be a function of the state: write "
            f"`def {word}(self, {arguments})`"
        )


def _function_of(member: Any) -> Any:
    """Returns the function of a static or class method, anything else as it is."""
    return getattr(member, "__func__", member)


def _check_takes_surroundings(method: Any, name: str, arguments: str) -> None:
    """Raises `ConfigError` for a method that does not take the position and the obstacles."""
    try:
        inspect.signature(method).bind("self", *arguments.split(", "))
    except TypeError as error:
        raise ConfigError(
            f"{name} must take ({arguments}): surroundings.clearance(x) is the distance of a state "
            "to the problem's obstacles"
        ) from error


def member_value(name: str, problem: Problem, x: Array) -> Any:
    """Returns what a member of `SHAPES` gives at a state (nx,)."""
    if name == "cost.penalty":
        return problem.penalty(x)
    if name == "problem.obstacles.clearance":
        return problem.clearance(x)
    if isinstance(problem.obstacles, ClosedFormClearance) and name.endswith("segment_clearance"):
        position = problem.position_of(x)
        return problem.obstacles.segment_clearance(position, position)
    if isinstance(problem.obstacles, ObstacleDistances) and name.endswith("distances"):
        return problem.obstacles.distances(problem.position_of(x))
    member = getattr(owner_of(problem, name), name.rpartition(".")[2])
    if name.startswith("problem.") or name == "cost.goal":
        return jnp.asarray(member)
    return member if name in CONSTANT else member(x)
