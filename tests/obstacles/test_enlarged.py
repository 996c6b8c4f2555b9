"""Obstacles with a border: of any shape, and as penalties about a centre see them."""

import jax
import jax.numpy as jnp
import numpy as np

import mppi_belief as mb
from mppi_belief.obstacles.enlarged import EnlargedObstacles, enlarge

CENTERS = np.array([[0.0, 0.0], [3.0, 1.0]])


@mb.struct
class HalfPlane:
    """Everything to the right of a line."""

    edge: float = mb.number()

    def clearance(self, position: jax.Array) -> jax.Array:
        return self.edge - position[0]


def test_discs_have_a_larger_radius(x64, rng):
    discs = EnlargedObstacles(mb.Obstacles(CENTERS, 0.6), jnp.asarray(0.25))
    larger = mb.Obstacles(CENTERS, 0.85)
    for position in jnp.asarray(rng.normal(size=(5, 2)) * 2):
        np.testing.assert_allclose(discs.distances(position), larger.distances(position))
        np.testing.assert_allclose(discs.clearance(position), larger.clearance(position))


def test_a_shape_that_knows_nothing_but_its_clearance_is_enlarged_too(x64):
    surroundings = mb.Surroundings(HalfPlane(2.0), components=(1, 0))
    nearer = enlarge(surroundings, jnp.asarray(0.5))
    state = jnp.array([7.0, 1.2])
    np.testing.assert_allclose(surroundings.clearance(state), 0.8)
    np.testing.assert_allclose(nearer.clearance(state), 0.3)
    np.testing.assert_allclose(nearer.obstacles.distances(nearer.position(state)), [0.3])


def test_without_obstacles_nothing_is_enlarged():
    surroundings = mb.Surroundings(None, None)
    assert enlarge(surroundings, jnp.asarray(1.0)) is surroundings
