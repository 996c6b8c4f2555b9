"""Says where a function that planners and filters differentiate has no useful derivative.

Values are finite at a kink, as that of a distance at its end, where derivatives are not. Filters
and schedules of covariances linearise the system; some planners expand the cost to second order and
take it for flat where they cannot. A function that changes in jumps alone is flat everywhere.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..numerics.dependence import dependence
from ..numerics.dependence_algebra import NOT_QUADRATIC
from ..planning.parts import ExpandsCost
from ..problem import Controller, Problem
from .members import member_value

LINEARISED = ("system.f", "system.G", "system.c")
EXPANDED = ("cost.base", "cost.penalty", "cost.terminal")
ROUNDED = "write a distance |x| as sqrt(|x|^2 + eps^2)"


def derivative_notes(problem: Problem, controller: Controller, states: np.ndarray) -> list[str]:
    """Returns a line for each function without derivatives, finite ones at all states (P, nx)."""
    names = LINEARISED + EXPANDED if expands_cost(controller) else LINEARISED
    curved = tuple(name for name in names if _may_have_kinks(problem, name))
    if not curved:
        return []
    notes = [_flat_note(name) for name in curved if name in EXPANDED and _has_steps(problem, name)]
    for name, derivatives in _derivatives(problem, states, curved).items():
        finite = np.isfinite(np.asarray(derivatives)).reshape(len(states), -1).all(axis=1)
        if not finite.all():
            state = np.round(states[np.argmin(finite)].astype(float), 4).tolist()
            notes.append(_note(name, state))
    return notes


def expands_cost(controller: Any) -> bool:
    """Says whether a controller or one of its parts differentiates the cost."""
    parts = [controller, *vars(controller).values()]
    return any(isinstance(part, ExpandsCost) and part.expands_cost for part in parts)


def _may_have_kinks(problem: Problem, name: str) -> bool:
    """Says whether a function is more than a polynomial of degree 2, which has derivatives."""

    def total(x: Array) -> Array:
        value: Array = member_value(name, problem, x)
        return value.sum()

    return dependence(total, problem.prior_mean).degree == NOT_QUADRATIC


def _has_steps(problem: Problem, name: str) -> bool:
    """Says whether a function of the cost is constant but for jumps, whatever its argument."""

    def slope(x: Array) -> Array:
        """Returns the sum of the gradient's components, each times a variable of its own."""
        gradient = jax.grad(functools.partial(member_value, name, problem))(x[: len(x) // 2])
        return gradient @ x[len(x) // 2 :]

    return not dependence(slope, jnp.tile(jnp.asarray(problem.prior_mean), 2)).components


@functools.partial(
    jax.jit, static_argnames="names", compiler_options={"xla_backend_optimization_level": 0}
)
def _derivatives(problem: Problem, states: Array, names: tuple[str, ...]) -> dict[str, Array]:
    """Returns Jacobians of functions of the system and Hessians of those of the cost."""

    def at_state(x: Array) -> dict[str, Array]:
        return {
            name: (jax.hessian if name in EXPANDED else jax.jacfwd)(
                functools.partial(member_value, name, problem)
            )(x)
            for name in names
        }

    return jax.vmap(at_state)(states)


def _flat_note(name: str) -> str:
    return (
        f"{name} changes in jumps alone, so its derivatives are zero: a planner that "
        "differentiates it does not see it; take another penalty, or moments by sigma_points"
    )


def _note(name: str, state: list[float]) -> str:
    if name in EXPANDED:
        return f"{name} has no finite derivatives at {state}: it counts as flat there; {ROUNDED}"
    return (
        f"{name} has no finite derivative at {state}: a filter or planner that linearises it there "
        f"diverges; {ROUNDED}"
    )
