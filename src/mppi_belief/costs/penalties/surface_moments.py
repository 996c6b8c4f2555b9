"""The sum of a penalty on distances to surfaces: its value, and its moments under a Gaussian state.

The moments are those of the first line that fits:

| penalty | obstacles | moments |
|---|---|---|
| `DistancePenalty` | half-spaces | `belief.half_space_moments`: closed forms, a rule for pairs |
| any other | any other | `belief.integration`: a rule for the components of the position |

Symbols: nx states, d components of the position.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from ...belief.half_space_moments import (
    HalfSpaceDistances,
    half_space_moments,
    quadratic_covariance,
)
from ...belief.integration import covariance, expected_value, integrand, variance
from ...numerics.linalg import as_matrix, matvec, minus, quadratic_form
from ...obstacles import HalfSpaces, Surroundings, is_plain, obstacle_distances
from ...obstacles.discs import MOST_UNROLLED
from .protocols import DistancePenalty, SurfacePenalty


class PenaltyMoments(NamedTuple):
    """Holds the moments of the sum of a penalty under a belief; every field is ()."""

    mean: Array  # expectation
    variance: Array
    covariance: Array  # with the base cost


def surface_sum(penalty: SurfacePenalty, x: Array, surroundings: Surroundings) -> Array:
    """Returns the sum () of a penalty over all obstacles, of which there are some, at a state.

    The state is (nx,). Raises `ValueError` for what is no penalty.
    """
    assert surroundings.obstacles is not None
    distances = obstacle_distances(surroundings.obstacles, surroundings.position(x))
    profile = _profile(penalty)
    if len(distances) > MOST_UNROLLED:
        return jnp.sum(profile(distances))
    # One by one: a sum over an axis is slower where the states of all paths are the last axis.
    values = [profile(distances[j]) for j in range(len(distances))]
    return sum(values, jnp.zeros_like(x[0]))


def surface_moments(
    penalty: SurfacePenalty,
    mean: Array,
    cov: Array,
    goal: Array,
    weight: Array,
    surroundings: Surroundings,
) -> PenaltyMoments:
    """Returns the moments of the sum over obstacles, by the rule for their shape.

    The arguments are those of `totals.penalty_moments`.
    """
    obstacles = surroundings.obstacles
    if not (is_plain(obstacles, HalfSpaces) and isinstance(penalty, DistancePenalty)):
        return _integrated(penalty, mean, cov, goal, weight, surroundings)
    if len(obstacles.normals) == 0:
        none = jnp.zeros_like(mean[0])
        return PenaltyMoments(none, none, none)

    # The distances and their covariance with the state.
    components = jnp.array(surroundings.position_components(len(mean)))
    normals = jnp.asarray(obstacles.normals)
    directions = normals @ cov[:, components].T
    spread = directions[:, components] @ normals.T
    distances = HalfSpaceDistances(obstacles.distances(surroundings.position(mean)), spread)

    # The moments of the penalty, and its covariance with the base cost.
    of_distance = penalty.distance_moments
    expectation, variance_of_sum = half_space_moments(
        penalty.profile, penalty.reach, of_distance, distances
    )
    hessian = as_matrix(weight)
    gradient = matvec(hessian, minus(mean, goal))
    with_base = quadratic_covariance(of_distance, distances, directions, gradient, hessian)
    return PenaltyMoments(expectation, variance_of_sum, with_base)


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
        lambda x: surface_sum(penalty, x, surroundings), mean, cov, f"cost.obstacle_penalty {kind}"
    )
    return PenaltyMoments(expected_value(total), variance(total), covariance(base, total))


def _profile(penalty: SurfacePenalty) -> Callable[[Array], Array]:
    """Returns the profile of a penalty; raises `ValueError` for what is none."""
    if not isinstance(penalty, SurfacePenalty):
        kind = type(penalty).__name__
        raise ValueError(f"obstacle_penalty must have profile(distance), {kind} has none")
    return penalty.profile
