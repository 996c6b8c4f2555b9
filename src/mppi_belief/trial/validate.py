"""Checks before any trial whether a problem can be run: its numbers, shapes and functions.

Shapes are traced, once for every structure. Values are computed at the prior mean, at the goal and
at a few states drawn from the prior, by one small program for every structure. A sweep over numbers
compiles nothing anew.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..discretise import measurement_cov, measurement_factor
from ..errors import ConfigError, FieldError
from ..problem import Problem
from .members import SHAPES, check_member, member_names, member_value, owner_of
from .traced_fields import reason_of

DRAWS = 4  # states from the prior at which functions are computed
SYMMETRIC = 1e-6  # relative to the largest entry of R
DEFINITE = 1e-12  # least eigenvalue of R, relative to the largest

Shape = tuple[int, ...]

MAY_BE_INFINITE = (
    "problem.obstacles.clearance",
    "problem.obstacles.segment_clearance",
    "problem.obstacles.distances",
)
MAY_BE_EMPTY = ("system.H", "problem.obstacles.distances")


def check_numbers(parts: Any, precision: str) -> None:
    """Raises `ConfigError` for a number of `parts` that the precision cannot hold."""
    for keys, leaf in jax.tree.leaves_with_path(parts):
        name = ".".join(str(getattr(key, "name", getattr(key, "key", key))) for key in keys)
        if name.startswith(("problem.system", "problem.cost")):
            name = name.removeprefix("problem.")
        try:
            with np.errstate(all="ignore"):
                value = np.asarray(leaf, dtype=precision)
        except (TypeError, ValueError, OverflowError) as error:
            reason = f"={leaf!r}: must be a number; words are made with choice"
            raise FieldError(name, reason) from error
        if not np.all(np.isfinite(value)):
            raise FieldError(name, f"={np.asarray(leaf).tolist()}: too large for {precision}")
        if name == "problem.dt" and value < np.finfo(precision).tiny:
            raise FieldError(name, f"={leaf:g}: too small for {precision}")


def check_problem(problem: Problem, precision: str) -> None:
    """Raises `ConfigError` for a member of the system, the cost or the obstacles that does not fit.

    A member does not fit if it is missing, fails, or returns another shape or type or a value that
    is not finite. Nor does a singular sigma_o, or an R that is not positive definite.
    """
    for name in member_names(problem):
        check_member(problem, name)
    _check_position(problem)
    leaves, structure = jax.tree.flatten(problem)
    _check_functions(structure, tuple(np.shape(leaf) for leaf in leaves), precision)
    _check_values(problem, precision)


def _check_position(problem: Problem) -> None:
    """Raises `ConfigError` for a component of the position that the state does not have."""
    position = problem.position or ()
    nx = len(problem.prior_mean)
    if any(component >= nx for component in position):
        raise ConfigError(
            f"problem.position={list(position)}: the state has components 0..{nx - 1}"
        )


@functools.cache
def _check_functions(structure: Any, shapes: tuple[Shape, ...], precision: str) -> None:
    """Raises `ConfigError` for a shape or type that does not fit, in the current precision."""
    leaves = [jax.ShapeDtypeStruct(shape, float) for shape in shapes]
    problem: Problem = jax.tree.unflatten(structure, leaves)
    modes = problem.prior_modes
    sizes: dict[str, int] = {"m": 1 if modes is None else max(1, len(modes))}
    for name in member_names(problem):
        shape = _shape(problem, name)
        for axis, size in enumerate(SHAPES[name]):
            # A vector in place of a matrix still tells how large the matrix must be.
            sizes.setdefault(size, shape[min(axis, len(shape) - 1)] if shape else 1)
        expected = tuple(sizes[size] for size in SHAPES[name])
        if shape != expected:
            nx = sizes["nx"]
            raise ConfigError(
                f"{name} has shape {shape}, must be {expected} for a state of shape ({nx},)"
            )
        if 0 in expected and name not in MAY_BE_EMPTY:
            raise ConfigError(f"{name} is empty")


def _shape(problem: Problem, name: str) -> Shape:
    """Returns the shape of a member at a state; raises `ConfigError` if it fails or is no array."""
    x: Any = jax.ShapeDtypeStruct(problem.prior_mean.shape, float)
    try:
        result = jax.eval_shape(functools.partial(member_value, name), problem, x)
    except Exception as error:
        reason = reason_of(error, owner_of(problem, name))
        raise ConfigError(f"{name} fails for a state of shape {x.shape}: {reason}") from error
    if not isinstance(result, jax.ShapeDtypeStruct):
        raise ConfigError(f"{name} returns a {type(result).__name__}, must return one array")
    if not jnp.issubdtype(result.dtype, jnp.floating):
        raise ConfigError(
            f"{name} returns {result.dtype}, must return floating-point numbers (1.0, not 1)"
        )
    return result.shape


# Compiled without optimisation, since it runs once for each cell.
@functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})
def _values(problem: Problem, states: Array) -> dict[str, Array]:
    """Returns what every member gives at states (P, nx), with one more axis (P, ...) in front."""

    def at_state(x: Array) -> dict[str, Any]:
        values = {name: member_value(name, problem, x) for name in member_names(problem)}
        values["problem.prior_std^2"] = jnp.asarray(problem.prior_std) ** 2
        values["system.sigma_o in measurements"] = measurement_factor(problem, x)
        values["system.sigma_o sigma_o' of measurements"] = measurement_cov(problem, x)
        return values

    return jax.vmap(at_state)(states)


def _check_values(problem: Problem, precision: str) -> None:
    """Raises `ConfigError` for a value that is not finite, a singular sigma_o, an unfit R."""
    states = checked_states(problem).astype(precision)
    try:
        results = _values(problem, states)
    except Exception as error:
        reason = reason_of(error, problem.system, problem.cost)
        raise ConfigError(
            f"system or cost cannot be computed for several states: {reason}"
        ) from error
    values = {name: np.asarray(value, dtype=float) for name, value in results.items()}
    for name, value in values.items():
        finite = np.isfinite(value)
        if name in MAY_BE_INFINITE:
            finite = ~np.isnan(value) & (value > -np.inf)
        _refuse(name, "is not finite", finite, states, value)

    # The noise must have an inverse, and the square of its least singular value must not underflow.
    singular_values = np.linalg.svd(values["system.sigma_o in measurements"], compute_uv=False)
    largest = singular_values[:, 0]
    least = singular_values[:, -1]
    limits = np.finfo(precision)
    regular = least > limits.eps * singular_values.shape[1] * largest
    invertible = regular & (least**2 > limits.tiny)
    _refuse("system.sigma_o", "is singular", invertible, states, values["system.sigma_o"])
    _check_control_weight(values["cost.R"][0])


def checked_states(problem: Problem) -> np.ndarray:
    """Returns the states (P, nx) at which values are checked."""
    mean = np.asarray(problem.prior_mean)
    std = np.asarray(problem.prior_std)
    draws = mean + std * np.random.default_rng(0).normal(size=(DRAWS, len(mean)))
    states = [mean, np.asarray(problem.cost.goal), draws]
    if problem.prior_modes is not None and len(problem.prior_modes):
        states.append(mean + np.asarray(problem.prior_modes))
    return np.vstack(states)


def _check_control_weight(R: np.ndarray) -> None:
    """Raises `ConfigError` for a control weight (nu, nu) that is not positive definite."""
    if not np.allclose(R, R.T, atol=SYMMETRIC * np.max(np.abs(R))):
        raise ConfigError(f"cost.R={R.tolist()}: must be symmetric")
    eigenvalues = np.linalg.eigvalsh(R)
    if eigenvalues[0] <= DEFINITE * abs(eigenvalues[-1]):
        raise ConfigError(f"cost.R={R.tolist()}: must be positive definite")


def _refuse(name: str, what: str, fine: np.ndarray, states: np.ndarray, value: np.ndarray) -> None:
    """Raises `ConfigError` for the first state (P, nx) where `fine` (P, ...) is not all true."""
    bad = np.flatnonzero(~np.all(fine.reshape(len(states), -1), axis=1))
    if len(bad):
        state = np.round(states[bad[0]].astype(float), 4).tolist()
        raise ConfigError(f"{name} {what} at the state {state}: {value[bad[0]].tolist()}")
