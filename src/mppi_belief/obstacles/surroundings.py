"""Tells a cost what it may know of the world around a state: its position and the obstacles.

Obstacles live in the space of positions (d,), costs are functions of the state (nx,). A problem
hands its cost these `Surroundings`, so that a cost need not know which components of the state are
the position.
"""

from typing import NamedTuple, Protocol, runtime_checkable

import jax.numpy as jnp
from jax import Array


@runtime_checkable
class ObstacleShape(Protocol):
    """Represents obstacles in the space of positions."""

    def clearance(self, position: Array) -> Array:
        """Returns the distance to the nearest surface, negative inside: (d,) -> ()."""


class Surroundings(NamedTuple):
    """Holds a problem's obstacles and its position, and answers for a state."""

    obstacles: ObstacleShape | None  # in the space of positions; None: there are none
    components: tuple[int, ...] | None  # of the state that are the position; None: all

    def position(self, x: Array) -> Array:
        """Returns the position of a state: (nx,) -> (d,).

        Raises `ValueError` for a component that the state does not have.
        """
        if self.components is None:
            return x
        if max(self.components) >= len(x):
            raise ValueError(f"position {list(self.components)} is not in a state of {len(x)}")
        if self.position_leads:
            return x[: len(self.components)]
        return jnp.stack([x[i] for i in self.components])

    def position_cov(self, cov: Array) -> Array:
        """Returns the covariance of the position: (nx, nx) -> (d, d)."""
        if self.components is None:
            return cov
        if self.position_leads:
            return cov[: len(self.components), : len(self.components)]
        components = jnp.array(self.components)
        return cov[components][:, components]

    def clearance(self, x: Array) -> Array:
        """Returns the distance from a state to the nearest surface: (nx,) -> ().

        It is negative inside an obstacle and inf without obstacles.
        """
        if self.obstacles is None:
            return jnp.asarray(jnp.inf)
        return self.obstacles.clearance(self.position(x))

    @property
    def position_leads(self) -> bool:
        """Says whether the position is the first components of the state, in their order."""
        return self.components is None or self.components == tuple(range(len(self.components)))

    def position_components(self, nx: int) -> list[int]:
        """Returns the components of a state (nx,) that are the position."""
        return list(range(nx) if self.components is None else self.components)

    def position_first(self, nx: int) -> list[int]:
        """Returns the order of the nx components that brings the position to the front."""
        front = self.position_components(nx)
        return front + [i for i in range(nx) if i not in front]
