"""The sum of a penalty over all obstacles: its value, and its moments under a Gaussian state.

Moments of penalties about centres have closed forms; `surface_moments` has those of the others.
"""

import jax.numpy as jnp
from jax import Array

from ...obstacles import Surroundings
from ...obstacles.enlarged import EnlargedObstacles
from .protocols import CenterPenalty, ObstaclePenalty
from .surface_moments import PenaltyMoments, surface_moments, surface_sum


def penalty_sum(penalty: ObstaclePenalty, x: Array, surroundings: Surroundings) -> Array:
    """Returns the sum () of a penalty over all obstacles at a state (nx,).

    Raises `ValueError` for obstacles without centres and a penalty that needs them.
    """
    if surroundings.obstacles is None:
        return jnp.zeros_like(x[0])
    if isinstance(penalty, CenterPenalty):
        centers = _centers(penalty, surroundings)
        if len(centers) == 0:
            return jnp.zeros_like(x[0])
        position = x if surroundings.position_leads else surroundings.position(x)
        if isinstance(surroundings.obstacles, EnlargedObstacles):
            centers = surroundings.obstacles.centers_towards(position[: centers.shape[-1]])
        return penalty.sum_about(position, centers)
    return surface_sum(penalty, x, surroundings)


def penalty_moments(
    penalty: ObstaclePenalty,
    mean: Array,
    cov: Array,
    goal: Array,
    weight: Array,
    surroundings: Surroundings,
) -> PenaltyMoments:
    """Returns the moments of the sum of a penalty over all obstacles.

    Args:
        penalty: of one obstacle
        mean: (nx,) of the state
        cov: (nx, nx) of the state
        goal: (nx,) of the base cost 1/2 (x - goal)' weight (x - goal)
        weight: (nx,) or (nx, nx)
        surroundings: the obstacles and the position
    """
    none = jnp.zeros_like(mean[0])
    if surroundings.obstacles is None:
        return PenaltyMoments(none, none, none)
    if not isinstance(penalty, CenterPenalty):
        return surface_moments(penalty, mean, cov, goal, weight, surroundings)
    centers = _centers(penalty, surroundings)
    if len(centers) == 0:
        return PenaltyMoments(none, none, none)

    # The closed forms about centres take the position from the front of the state.
    if not surroundings.position_leads:
        order = jnp.array(surroundings.position_first(len(goal)))
        mean = mean[order]
        cov = cov[order][:, order]
        goal = goal[order]
        weight = weight[order] if weight.ndim == 1 else weight[order][:, order]
    expectation, spread = penalty.moments_about(mean, cov, centers)
    with_base = penalty.covariance_about(mean, cov, goal, weight, centers)
    return PenaltyMoments(expectation, spread, with_base)


def _centers(penalty: CenterPenalty, surroundings: Surroundings) -> Array:
    """Returns the centres (n, d) of the obstacles; raises `ValueError` if they have none."""
    centers = getattr(surroundings.obstacles, "centers", None)
    if centers is None:
        kind = type(surroundings.obstacles).__name__
        raise ValueError(
            f"obstacle_penalty: {type(penalty).__name__} needs obstacles with centers, {kind} has "
            "none; use Hinge, SquaredHinge, SmoothStep or Indicator"
        )
    return jnp.asarray(centers)
