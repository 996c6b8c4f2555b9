"""Parts as a user might write them: some wrong, some unlucky. Named in configurations by `_target_`."""

from dataclasses import dataclass, field
from typing import Any

import jax.numpy as jnp
from jax import Array

import mppi_belief as mb
from helpers import Info
from mppi_belief.pytree import choice, number, struct

CALLS: list[str] = []


def launch(*args: Any, **settings: Any) -> None:
    """Not to be called by a configuration."""
    CALLS.append("launch")


class Plain:
    """A class, but no struct."""

    def __init__(self, **settings: Any) -> None:
        CALLS.append("Plain")


@dataclass
class PlainDataclass:
    """A dataclass, but no struct: its fields are unchecked and JAX does not know it."""

    gain: float = 1.0
    made: None = field(default=None, init=False)

    def __post_init__(self) -> None:
        CALLS.append("PlainDataclass")


@struct
class Drifting:
    """Two states, one control: x' = growth x^3 + (0, u), each function wrong if `wrong` names it."""

    growth: float = number(0.0)
    wrong: str = choice("nothing", "f", "G", "H", "c", "sigma_o", "clearance", "c_raises", "H_raises")
    noise_convention: str = choice("sample", "intensity")

    def _right(self, name: str, value: Array) -> Array:
        if self.wrong == f"{name}_raises":
            raise RuntimeError(f"{name} is not feeling well\nat all")
        return value[..., None] if self.wrong == name else value

    @property
    def H(self) -> Array:
        return self._right("H", 0.1 * jnp.eye(2))

    def f(self, x: Array) -> Array:
        return self._right("f", self.growth * x**3)

    def G(self, x: Array) -> Array:
        return self._right("G", jnp.array([[0.0], [1.0]]))

    def c(self, x: Array) -> Array:
        return self._right("c", x[:1])

    def sigma_o(self, x: Array) -> Array:
        return self._right("sigma_o", jnp.full((1, 1), 0.2))

    def position(self, x: Array) -> Array:
        return x[:1]

    def clearance(self, x: Array) -> Array:
        return self._right("clearance", jnp.asarray(jnp.inf))


@struct
class Constant:
    """A controller that always says the same; `wrong` makes it ill-behaved."""

    value: float = number(0.0)
    wrong: str = choice("nothing", "shape", "info", "raises")

    def init(self, problem: mb.Problem) -> Array:
        return jnp.zeros(())

    def act(self, problem: mb.Problem, belief: mb.Belief, plan: Array, key: Array) -> tuple[Array, Array, Any]:
        if self.wrong == "raises":
            raise RuntimeError("no plan survives\nthe first step")
        n_controls = len(problem.cost.R) + (self.wrong == "shape")
        return jnp.full(n_controls, self.value), plan, None if self.wrong == "info" else Info(jnp.ones(()))
