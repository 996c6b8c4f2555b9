"""The distance from a position to each of several obstacles.

A shape that is made of n obstacles may say how far each of them is (`ObstacleDistances`). Any other
shape counts as one obstacle, at the distance that its `clearance` gives.
"""

from typing import Protocol, TypeGuard, TypeVar, runtime_checkable

from jax import Array

from .surroundings import ObstacleShape

Shape = TypeVar("Shape", bound=ObstacleShape)


@runtime_checkable
class ObstacleDistances(ObstacleShape, Protocol):
    """Adds to obstacles the distance to each of them."""

    def distances(self, position: Array) -> Array:
        """Returns the distance to each surface, negative inside: (d,) -> (n,).

        `clearance` is the least of them.
        """


def obstacle_distances(obstacles: ObstacleShape, position: Array) -> Array:
    """Returns the distance (n,) from a position (d,) to each obstacle, to one if n is unknown."""
    if isinstance(obstacles, ObstacleDistances) and agrees_with_clearance(obstacles, "distances"):
        return obstacles.distances(position)
    return obstacles.clearance(position)[None]


def is_plain(obstacles: ObstacleShape | None, kind: type[Shape]) -> TypeGuard[Shape]:
    """Says whether obstacles are of a kind, or of a subclass that does not change distances."""
    names = ("clearance", "distances")
    if not isinstance(obstacles, kind):
        return False
    return all(getattr(type(obstacles), name) is getattr(kind, name) for name in names)


def agrees_with_clearance(obstacles: ObstacleShape, ability: str) -> bool:
    """Says whether a method of the obstacles was written for the class's own `clearance`.

    It was not where a subclass changes `clearance` and inherits the method.
    """
    definers = []
    for name in (ability, "clearance"):
        bases = (base for base in type(obstacles).__mro__ if name in vars(base))
        definers.append(next(bases, object))
    return issubclass(definers[0], definers[1])
