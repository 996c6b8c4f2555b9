"""A penalty that rises smoothly from 0 at the margin of an obstacle to 1 at its surface.

h(d) = 3 t^2 - 2 t^3,   t = clip((m - d) / m, 0, 1)

Under a Gaussian d the moments are those of the slope, by the rule of `belief.interval_rule`, and
those of the plateau, in closed form. The variance is a sum of positive terms.
"""

import jax.numpy as jnp
from jax import Array

from ...belief.half_space_moments import DistanceMoments
from ...belief.interval_rule import interval_nodes, normal_cdf
from ...numerics.linalg import dot
from ...structs import number, struct

N_NODES_OF_SLOPE = 16


@struct
class SmoothStep:
    """Charges 1 inside every obstacle, falling to 0 over a margin around it."""

    margin: float = number(gt=0)  # m, around the surface

    def profile(self, distance: Array) -> Array:
        """Returns the penalty (0 to 1) at a distance (m) to a surface, of any shape."""
        t = jnp.clip(1.0 - distance / self.margin, 0.0, 1.0)
        return t * t * (3.0 - 2.0 * t)

    @property
    def reach(self) -> float:
        """Returns the distance (m) from which on there is no penalty."""
        return self.margin

    def distance_moments(self, mean: Array, sd: Array) -> DistanceMoments:
        """Returns the moments for a distance d ~ N(mean, sd^2), sd > 0."""
        nodes = interval_nodes(0.0, self.margin, mean, sd, N_NODES_OF_SLOPE)
        values = [self.profile(point) for point in nodes.points]
        on_plateau = normal_cdf(-mean / sd)
        beyond = normal_cdf((mean - self.margin) / sd)
        expectation = on_plateau + nodes.probability * dot(nodes.fractions, values)
        deviations = [(value - expectation) ** 2 for value in values]
        variance = (
            nodes.probability * dot(nodes.fractions, deviations)
            + on_plateau * (1.0 - expectation) ** 2
            + beyond * expectation**2
        )

        # Derivatives of the profile on the slope.
        t = [1.0 - point / self.margin for point in nodes.points]
        first_derivatives = [-6 * each * (1 - each) / self.margin for each in t]
        second_derivatives = [6 * (1 - 2 * each) / self.margin**2 for each in t]
        return DistanceMoments(
            expectation,
            variance,
            nodes.probability * dot(nodes.fractions, first_derivatives),
            nodes.probability * dot(nodes.fractions, second_derivatives),
        )
