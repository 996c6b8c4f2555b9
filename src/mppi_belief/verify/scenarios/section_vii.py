"""The system and the cost of Sec. VII with the numbers of conf/."""

from functools import cache
from typing import Any

import jax.numpy as jnp
from jax import Array

from ...config.reference import reference, reference_settings
from ...costs import GoalObstacleCost
from ...problem import Problem
from ...systems import LightDark


@cache
def light_dark_numbers() -> dict[str, Any]:
    """Returns the numbers of the light-dark system by their names in conf/."""
    numbers = reference("system", "light_dark")["system"]
    return {name: number for name, number in numbers.items() if name != "_target_"}


@cache
def problem_numbers() -> dict[str, Any]:
    """Returns the prior and the time grid of the light-dark problem by their names in conf/."""
    return dict(reference("system", "light_dark")["problem"])


@cache
def cost_numbers() -> dict[str, Any]:
    """Returns the numbers of the goal-and-obstacles cost by their names in conf/."""
    return dict(reference("cost", "goal_obstacles"))


@cache
def bump_cost_numbers() -> dict[str, Any]:
    """Returns the numbers of the cost with Gaussian bumps, as calibrated for that penalty."""
    return dict(reference("experiment", "table_1_bumps")["cost"])


@cache
def reference_theta() -> float:
    """Returns the risk aversion theta of Sec. VII."""
    return float(reference_settings()["theta"])


def light_dark_problem(
    convention: str,
    mean: Array,
    std: Array,
    dt: float,
    steps: int,
    noise_floor: Array | float | None = None,
) -> Problem:
    """Returns the system of Sec. VII without obstacles, with a cost of unit weights.

    `convention` says what sigma_o is ("intensity" or "sample"), and the prior is
    N(mean, diag(std^2)). `noise_floor` replaces sigma_o in the light.
    """
    numbers = light_dark_numbers()
    if noise_floor is not None:
        numbers = numbers | {"noise_floor": noise_floor}
    system = LightDark(**numbers)
    unit = jnp.ones(4)
    cost = GoalObstacleCost(jnp.zeros(4), unit, unit, jnp.ones(2))
    return Problem(system, cost, mean, std, dt, steps, noise_convention=convention)
