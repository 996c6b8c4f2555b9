"""Computes how near the straight lines between consecutive positions come to obstacles.

    clearance of step k = min over s in [0, 1] of clearance(p_k + s (p_{k+1} - p_k))

Obstacles that know this minimum in closed form (`ClosedFormClearance`) give it exactly. For all
others `clearance` is computed at points of the line that are at most `resolution` apart, its ends
included. An obstacle then goes unnoticed only where the line is inside it for less than that, and
if `clearance` is a distance, the minimum is exceeded by at most half of it.

Symbols: T steps, d components of the position.
"""

from typing import Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jax import Array

from .distances import agrees_with_clearance
from .surroundings import ObstacleShape

MAX_INTERVALS = 1000  # into which a line is divided; bounds the work where a trial diverges


@runtime_checkable
class ClosedFormClearance(ObstacleShape, Protocol):
    """Adds to obstacles the exact clearance of a straight line; that of others is sampled."""

    def segment_clearance(self, start: Array, end: Array) -> Array:
        """Returns the least clearance () on the line between two positions (d,)."""


def path_clearance(obstacles: ObstacleShape, positions: Array, resolution: Array | float) -> Array:
    """Returns the least clearance (T,) on the line of every step between positions (T+1, d).

    A line longer than 1000 times the resolution (m) is sampled at a thousandth of its length.
    """
    at_positions = jax.vmap(obstacles.clearance)(positions)
    at_ends = jnp.minimum(at_positions[:-1], at_positions[1:])

    def between(start: Array, end: Array) -> Array:
        inherited = not agrees_with_clearance(obstacles, "segment_clearance")
        if inherited or not isinstance(obstacles, ClosedFormClearance):
            return _sampled_clearance(obstacles, start, end, resolution)
        return obstacles.segment_clearance(start, end)

    return jnp.minimum(at_ends, jax.vmap(between)(positions[:-1], positions[1:]))


def _sampled_clearance(
    obstacles: ObstacleShape, start: Array, end: Array, resolution: Array | float
) -> Array:
    """Returns the least clearance () at points between two positions (d,), inf without any."""
    step = end - start
    intervals = jnp.ceil(jnp.sqrt(jnp.sum(step**2)) / resolution)
    intervals = jnp.clip(jnp.nan_to_num(intervals), 1, MAX_INTERVALS)

    def take_point(carry: tuple[Array, Array]) -> tuple[Array, Array]:
        point, least = carry
        clearance = obstacles.clearance(start + point / intervals * step)
        return point + 1, jnp.minimum(least, clearance).astype(least.dtype)

    first = (jnp.ones_like(intervals), jnp.full_like(intervals, jnp.inf))
    return jax.lax.while_loop(lambda carry: carry[0] < intervals, take_point, first)[1]
