"""The sum of a penalty over all obstacles: its value, and its moments under a Gaussian state.

Penalties about centres have closed forms. Those on the distance to a surface are integrated by the
rule for the components of the position (`belief.integration`).
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from ...belief.integration import covariance, expected_value, integrand, variance
from ...numerics.linalg import minus, quadratic_form
from ...obstacles import Surroundings, obstacle_distances
from ...obstacles.enlarged import EnlargedObstacles
from .protocols import CenterPenalty, ObstaclePenalty, SurfacePenalty


class PenaltyMoments(NamedTuple):
    """Holds the moments of the sum of a penalty under a belief; every field is ()."""

    mean: Array  # expectation
    variance: Array
    covariance: Array  # with the base cost


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
    distances = obstacle_distances(surroundings.obstacles, surroundings.position(x))
    return jnp.sum(_profile(penalty)(distances))


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
        return _integrated(penalty, mean, cov, goal, weight, surroundings)
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


def _integrated(
    penalty: SurfacePenalty,
    mean: Array,
    cov: Array,
    goal: Array,
    weight: Array,
    surroundings: Surroundings,
) -> PenaltyMoments:
    """Returns the moments by a rule for the components that the penalty depends on."""
    kind = type(penalty).__name__
    base = integrand(
        lambda x: 0.5 * quadratic_form(weight, minus(x, goal)), mean, cov, "the quadratic base"
    )
    total = integrand(
        lambda x: penalty_sum(penalty, x, surroundings), mean, cov, f"cost.obstacle_penalty {kind}"
    )
    return PenaltyMoments(expected_value(total), variance(total), covariance(base, total))


def _profile(penalty: SurfacePenalty) -> Callable[[Array], Array]:
    """Returns the profile of a penalty; raises `ValueError` for what is none."""
    if not isinstance(penalty, SurfacePenalty):
        kind = type(penalty).__name__
        raise ValueError(f"obstacle_penalty must have profile(distance), {kind} has none")
    return penalty.profile


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
