"""Defines parts as a user might write them, some of them wrong; `_target_` names them."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

import mppi_belief as mb
from helpers import Info
from mppi_belief.structs import choice, number, struct

CALLS: list[str] = []
SPOILABLE = ("f", "G", "H", "c", "sigma_o")


def launch(*args: Any, **settings: Any) -> None:
    """Does what no configuration may do: it is called."""
    CALLS.append("launch")


class Plain:
    """Represents a class that is no struct."""

    def __init__(self, **settings: Any) -> None:
        CALLS.append("Plain")


@dataclass
class PlainDataclass:
    """Represents a dataclass that is no struct, so that JAX does not know it."""

    gain: float = 1.0
    derived: None = field(default=None, init=False)

    def __post_init__(self) -> None:
        CALLS.append("PlainDataclass")


SPOILS: dict[str, Callable[[Array], Any]] = {
    "shape": lambda value: value[..., None],
    "nan": lambda value: value * jnp.nan,
    "inf": lambda value: value + jnp.inf,
    "-inf": lambda value: value - jnp.inf,
    "zero": lambda value: 0 * value,
    "negative": lambda value: -value,
    "integer": lambda value: jnp.round(value).astype(int),
    "bool": lambda value: value > 0,
    "complex": lambda value: value + 0j,
    "list": lambda value: [value],
    "none": lambda value: None,
    "word": lambda value: "word",
    "empty": lambda value: value[:0],
    "branches": lambda value: value if jnp.sum(value) > 0 else -value,
    "numpy": lambda value: np.abs(np.asarray(value)),
}


@struct
class Drifting:
    """Represents x' = growth x^3 + (0, u); the member `wrong` is spoilt in the way of `how`."""

    growth: float = number(default=0.0)
    wrong: str = choice("nothing", *SPOILABLE, default="nothing")
    how: str = choice("shape", "raises", *SPOILS, default="shape")

    def _right(self, name: str, value: Array) -> Any:
        if self.wrong != name:
            return value
        if self.how == "raises":
            raise RuntimeError(f"{name} is not feeling well\nat all")
        return SPOILS[self.how](value)

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


@struct
class Fog:
    """Represents obstacles that are always one metre away, spoilt in the way of `how`."""

    how: str = choice("nothing", "raises", *SPOILS, default="nothing")

    def clearance(self, position: Array) -> Array:
        if self.how == "raises":
            raise RuntimeError("clearance is not feeling well\nat all")
        distance = position[0] * 0 + 1
        return distance if self.how == "nothing" else SPOILS[self.how](distance)


@struct
class SpoiltStep(Fog):
    """Represents obstacles whose closed form of a step has the wrong shape."""

    def segment_clearance(self, start: Array, end: Array) -> Array:
        return self.clearance(start)[None]


@struct
class Ghost:
    """Represents obstacles without a clearance."""


@struct
class Mute:
    """Represents a system without a measurement `c`."""

    H = property(lambda self: jnp.eye(2))
    f = G = sigma_o = lambda self, x: x


@struct
class Moored(Drifting):
    """Represents a system that has what is given to the problem."""

    noise_convention: str = choice("sample", "intensity", default="sample")

    def position(self, x: Array) -> Array:
        return x[:1]

    def clearance(self, x: Array) -> Array:
        return x[0]


@struct
class Squally(Drifting):
    """Represents a system whose process noise is a method of the state."""

    def H(self, x: Array) -> Array:
        return x[0] * jnp.eye(2)


@struct
class Rows:
    """Represents a system whose size is a field that was not declared with `size`."""

    n: int = 2
    H = property(lambda self: jnp.eye(2))
    c = f = lambda self, x: x

    def G(self, x: Array) -> Array:
        return jnp.zeros((self.n, 1))

    def sigma_o(self, x: Array) -> Array:
        return jnp.eye(2)


@struct
class Switched(Drifting):
    """Represents a system with a switch that was not declared with `choice`."""

    on: bool = True

    def f(self, x: Array) -> Array:
        return x if self.on else -x


@struct
class Fixed(Drifting):
    """Represents a system whose drift is a property."""

    @property
    def f(self) -> Array:
        return jnp.zeros(2)


@struct
class Price:
    """Represents a cost of two states and one control, spoilt as `Drifting` is."""

    wrong: str = choice("nothing", "R", "goal", "base", "penalty", "terminal", default="nothing")
    how: str = choice("shape", *SPOILS, default="shape")

    def _right(self, name: str, value: Array) -> Any:
        return SPOILS[self.how](value) if self.wrong == name else value

    @property
    def R(self) -> Array:
        return self._right("R", jnp.ones((1, 1)))

    @property
    def goal(self) -> Array:
        return self._right("goal", jnp.ones(2))

    def base(self, x: Array) -> Array:
        return self._right("base", jnp.sum(x**2))

    def penalty(self, x: Array, surroundings: mb.Surroundings) -> Array:
        return self._right("penalty", jnp.sum(x))

    def terminal(self, x: Array) -> Array:
        return self._right("terminal", jnp.sum(x))


@struct
class Blind(Price):
    """Represents a cost whose penalty does not take the surroundings."""

    def penalty(self, x: Array) -> Array:
        return jnp.sum(x)


@struct
class Danger:
    """Represents a logistic danger beside a wall at `edge` of the first component."""

    goal: Array = mb.array(ndim=1)
    edge: float = number()  # m
    w: float = number(default=100.0, ge=0)
    reach: float = number(default=0.05, gt=0)  # m

    @property
    def R(self) -> Array:
        return jnp.eye(2)

    def base(self, x: Array) -> Array:
        return 0.0 * x[0]

    def penalty(self, x: Array, surroundings: mb.Surroundings) -> Array:
        return self.w / (1.0 + jnp.exp((self.edge - x[0]) / self.reach))

    def terminal(self, x: Array) -> Array:
        return self.w / (1.0 + jnp.exp((self.edge - x[0]) / self.reach))


@struct
class Crowded:
    """Represents a quadratic cost of six states whose penalty depends on all of them."""

    goal: Array = mb.array(ndim=1)

    @property
    def R(self) -> Array:
        return jnp.eye(6)

    def base(self, x: Array) -> Array:
        return jnp.sum((x - jnp.asarray(self.goal)) ** 2)

    def penalty(self, x: Array, surroundings: mb.Surroundings) -> Array:
        return 1.0 + jnp.tanh(jnp.sum(x))

    def terminal(self, x: Array) -> Array:
        return self.base(x)


@struct
class RangeOnly:
    """Represents a point of which the distance to the origin is measured."""

    @property
    def H(self) -> Array:
        return 0.1 * jnp.eye(2)

    def f(self, x: Array) -> Array:
        return jnp.zeros(2)

    def G(self, x: Array) -> Array:
        return jnp.eye(2)

    def c(self, x: Array) -> Array:
        return jnp.sqrt(jnp.sum(x**2))[None]

    def sigma_o(self, x: Array) -> Array:
        return jnp.eye(1)


@struct
class Fare:
    """Represents a cost of two states: the distance to a goal, rounded off below `smoothing`."""

    goal: Array = mb.array(ndim=1)
    smoothing: float = number(default=0.0, ge=0)  # m

    @property
    def R(self) -> Array:
        return 0.1 * jnp.eye(2)

    def base(self, x: Array) -> Array:
        return jnp.sqrt(jnp.sum((x - jnp.asarray(self.goal)) ** 2) + self.smoothing**2)

    def penalty(self, x: Array, surroundings: mb.Surroundings) -> Array:
        return 0.0 * x[0]

    def terminal(self, x: Array) -> Array:
        return self.base(x)


@struct
class Constant:
    """Returns the same control at every step; `wrong` makes it ill-behaved."""

    value: float = number(default=0.0)
    wrong: str = choice("nothing", "shape", "info", "raises", default="nothing")

    def init(self, problem: mb.Problem) -> Array:
        return jnp.zeros(())

    def act(
        self, problem: mb.Problem, belief: mb.Belief, plan: Array, key: Array
    ) -> tuple[Array, Array, Any]:
        if self.wrong == "raises":
            raise RuntimeError("no plan survives\nthe first step")
        n_controls = len(problem.cost.R) + (self.wrong == "shape")
        return (
            jnp.full(n_controls, self.value),
            plan,
            None if self.wrong == "info" else Info(jnp.ones(())),
        )
