"""Whether a problem can be run at all: what its numbers, its shapes and its functions are, before any trial.

Shapes are traced, once for every structure; values are computed at the prior mean, at the goal and at a few states
drawn from the prior, by one small program for every structure. A sweep over numbers compiles nothing anew.
"""

import functools
import inspect
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..discretise import measurement_cov, measurement_factor
from ..errors import ConfigError
from ..problem import Problem

CONVENTIONS = ("sample", "intensity")
DRAWS = 4  # states from the prior at which functions are computed
NEEDED = {
    "system": ("noise_convention", "H", "f", "G", "c", "sigma_o", "position", "clearance"),
    "cost": ("R", "goal", "base", "penalty", "terminal"),
}
_UNTRACED = "it needs the values of its state, as `if`, `float` and NumPy do; JAX has jnp.where and jnp.* for that"
_TRACERS = (jax.errors.ConcretizationTypeError, jax.errors.TracerArrayConversionError)


def check_numbers(parts: Any, precision: str) -> None:
    """Raise `ConfigError` for a number of `parts` that the precision cannot hold."""
    for keys, leaf in jax.tree.leaves_with_path(parts):
        name = ".".join(str(getattr(key, "name", getattr(key, "key", key))) for key in keys)
        name = (
            name.removeprefix("problem.")
            if name.startswith(("problem.system", "problem.cost"))
            else name
        )
        try:
            with np.errstate(all="ignore"):
                value = np.asarray(leaf, dtype=precision)
        except (TypeError, ValueError, OverflowError) as error:
            raise ConfigError(
                f"{name}={leaf!r}: must be a number; words are made with choice"
            ) from error
        if not np.all(np.isfinite(value)):
            raise ConfigError(f"{name}={np.asarray(leaf).tolist()}: too large for {precision}")
        if name == "problem.dt" and value < np.finfo(precision).tiny:
            raise ConfigError(f"{name}={leaf:g}: too small for {precision}")


def check_problem(problem: Problem, precision: str) -> None:
    """Raise `ConfigError` for a function of the system or the cost that is missing, fails, or returns what it should
    not: another shape or type, nothing finite, a singular sigma_o, an R that is not positive definite."""
    for group, names in NEEDED.items():
        part = getattr(problem, group)
        for name in names:
            if inspect.getattr_static(part, name, None) is None:
                raise ConfigError(f"{group}.{name} is missing: {type(part).__name__} must have it")
    if problem.system.noise_convention not in CONVENTIONS:
        said = problem.system.noise_convention
        raise ConfigError(
            f"system.noise_convention={said!r}: must be one of {', '.join(CONVENTIONS)}"
        )
    leaves, structure = jax.tree.flatten(problem)
    _check_functions(structure, tuple(np.shape(leaf) for leaf in leaves), precision)
    _check_values(problem, precision)


@functools.cache
def _check_functions(structure: Any, shapes: tuple[tuple[int, ...], ...], precision: str) -> None:
    """Every function takes a state of the prior's size and returns what it should; traced in the current precision."""
    problem: Problem = jax.tree.unflatten(
        structure, [jax.ShapeDtypeStruct(shape, float) for shape in shapes]
    )

    def shape(
        name: str, function: Callable[[Problem, Array], Any], wanted: tuple[int, ...] | None = None
    ) -> tuple[int, ...]:
        return _shape(name, function, problem, wanted)

    nx = len(problem.prior_mean)
    shape("prior_std", lambda p, x: jnp.asarray(p.prior_std), (nx,))
    modes = 1 if problem.prior_modes is None else max(1, len(problem.prior_modes))
    if problem.prior_modes is not None:
        shape("problem.prior_modes", lambda p, x: jnp.asarray(p.prior_modes), (modes, nx))
    if problem.prior_weights is not None:
        shape("problem.prior_weights", lambda p, x: jnp.asarray(p.prior_weights), (modes,))
    shape("cost.goal", lambda p, x: jnp.asarray(p.cost.goal), (nx,))
    nu = shape("cost.R", lambda p, x: p.cost.R)[0]
    shape("cost.R", lambda p, x: p.cost.R, (nu, nu))
    shape("system.f", lambda p, x: p.system.f(x), (nx,))
    shape("system.G", lambda p, x: p.system.G(x), (nx, nu))
    nw = shape("system.H", lambda p, x: p.system.H)[-1]
    shape("system.H", lambda p, x: p.system.H, (nx, nw))
    ny = shape("system.c", lambda p, x: p.system.c(x))[0]
    shape("system.c", lambda p, x: p.system.c(x), (ny,))
    shape("system.sigma_o", lambda p, x: p.system.sigma_o(x), (ny, ny))
    d = shape("system.position", lambda p, x: p.system.position(x))[0]
    shape("system.position", lambda p, x: p.system.position(x), (d,))
    shape("system.clearance", lambda p, x: p.system.clearance(x), ())
    shape("cost.base", lambda p, x: p.cost.base(x), ())
    shape("cost.penalty", lambda p, x: p.cost.penalty(x), ())
    shape("cost.terminal", lambda p, x: p.cost.terminal(x), ())
    for name, n in (
        ("problem.prior_mean", nx),
        ("cost.R", nu),
        ("system.c", ny),
        ("system.position", d),
    ):
        if n == 0:
            raise ConfigError(f"{name} is empty")


def _shape(
    name: str,
    function: Callable[[Problem, Array], Any],
    problem: Problem,
    wanted: tuple[int, ...] | None,
) -> tuple[int, ...]:
    """The shape that `function` returns for a state; raises `ConfigError` if it fails or is not the one wanted."""
    x: Any = jax.ShapeDtypeStruct(problem.prior_mean.shape, float)
    try:
        got = jax.eval_shape(function, problem, x)
    except Exception as error:
        why = _UNTRACED if isinstance(error, _TRACERS) else first_line(error)
        raise ConfigError(f"{name} fails for a state of shape {x.shape}: {why}") from error
    if not isinstance(got, jax.ShapeDtypeStruct):
        raise ConfigError(f"{name} returns a {type(got).__name__}, must return one array")
    if wanted is not None and got.shape != wanted:
        raise ConfigError(
            f"{name} has shape {got.shape}, must be {wanted} for a state of shape {x.shape}"
        )
    if not jnp.issubdtype(got.dtype, jnp.floating):
        raise ConfigError(
            f"{name} returns {got.dtype}, must return floating-point numbers (1.0, not 1)"
        )
    return got.shape or (1,)


def first_line(error: Exception) -> str:
    """What an exception says first, or its name."""
    return next(iter(str(error).strip().splitlines()), type(error).__name__)


@functools.partial(
    jax.jit, compiler_options={"xla_backend_optimization_level": 0}
)  # it runs once for each cell
def _values(problem: Problem, states: Array) -> dict[str, Array]:
    """What every function returns at states (P, nx), each with one more axis (P, ...) at the front."""
    system, cost = problem.system, problem.cost

    def at(x: Array) -> dict[str, Any]:
        return {
            "prior_std^2": jnp.asarray(problem.prior_std) ** 2,
            "cost.goal": jnp.asarray(cost.goal),
            "cost.R": cost.R,
            "system.H": system.H,
            **{
                f"system.{name}": getattr(system, name)(x)
                for name in ("f", "G", "c", "position", "sigma_o")
            },
            "system.sigma_o in measurements": measurement_factor(system, x, problem.dt),
            "system.sigma_o sigma_o' of measurements": measurement_cov(system, x, problem.dt),
            "system.clearance": system.clearance(x),
            **{f"cost.{name}": getattr(cost, name)(x) for name in ("base", "penalty", "terminal")},
        }

    return jax.vmap(at)(states)


def _check_values(problem: Problem, precision: str) -> None:
    """Everything is finite (clearance may be inf), sigma_o invertible and R positive definite, at a few states."""
    mean, std, goal = (
        np.asarray(part) for part in (problem.prior_mean, problem.prior_std, problem.cost.goal)
    )
    draws = mean + std * np.random.default_rng(0).normal(size=(DRAWS, len(mean)))
    modes = () if problem.prior_modes is None else mean + np.asarray(problem.prior_modes)
    states = np.vstack([mean, goal, draws, *modes]).astype(precision)
    try:
        values = {
            name: np.asarray(value, dtype=float) for name, value in _values(problem, states).items()
        }
    except Exception as error:
        raise ConfigError(
            f"system or cost cannot be computed for several states: {first_line(error)}"
        ) from error
    for name, value in values.items():
        fine = (
            ~np.isnan(value) & (value > -np.inf)
            if name == "system.clearance"
            else np.isfinite(value)
        )
        _refuse(name, "is not finite", fine, states, value)
    sizes = np.linalg.svd(values["system.sigma_o in measurements"], compute_uv=False)
    limits = np.finfo(precision)
    invertible = (sizes[:, -1] > limits.eps * sizes.shape[1] * sizes[:, 0]) & (
        sizes[:, -1] ** 2 > limits.tiny
    )
    _refuse("system.sigma_o", "is singular", invertible, states, values["system.sigma_o"])
    R = values["cost.R"][0]
    if not np.allclose(R, R.T, atol=1e-6 * np.max(np.abs(R))):
        raise ConfigError(f"cost.R={R.tolist()}: must be symmetric")
    least, *_, most = (*np.linalg.eigvalsh(R),) * 2
    if least <= 1e-12 * abs(most):
        raise ConfigError(f"cost.R={R.tolist()}: must be positive definite")


def _refuse(name: str, what: str, fine: np.ndarray, states: np.ndarray, value: np.ndarray) -> None:
    """Raise `ConfigError` with the first of the states (P, nx) at which not all of `fine` (P, ...) is true."""
    bad = np.flatnonzero(~np.all(fine.reshape(len(states), -1), axis=1))
    if len(bad):
        at, got = np.round(states[bad[0]].astype(float), 4).tolist(), value[bad[0]].tolist()
        raise ConfigError(f"{name} {what} at the state {at}: {got}")
