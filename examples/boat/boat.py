"""A boat in a current, located by a radar ashore: a system and a cost of one's own."""

import jax.numpy as jnp
from jax import Array

import mppi_belief as mb


@mb.struct
class Boat:
    """Represents a boat: the state is its position p = [east, north] in m, the control a velocity.

    dp = (current(p) + u) dt + sigma_w dw,    y = p + sigma_o(p) v

    The velocity u is that through the water, in m/s. The current is strongest in mid-stream, and
    sigma_o grows with the distance from the radar.
    """

    current: float = mb.number()  # m/s, to the north in mid-stream (east = 0)
    gusts: float = mb.number(ge=0)  # sigma_w, m/s^0.5
    radar: mb.ArrayField = mb.array(ndim=1)  # its position, m
    resolution: float = mb.number(gt=0)  # m, at the radar
    spread: float = mb.number(ge=0)  # m per m of distance

    state_labels = ("east (m)", "north (m)")  # of the axes of pictures
    measurement_units = ("m", "m")

    @property
    def H(self) -> Array:
        return self.gusts * jnp.eye(2)

    def f(self, x: Array) -> Array:
        return jnp.stack([0.0 * x[0], self.current * jnp.exp(-(x[0] ** 2))])

    def G(self, x: Array) -> Array:
        return jnp.eye(2)

    def c(self, x: Array) -> Array:
        return x

    def sigma_o(self, x: Array) -> Array:
        away = x - jnp.asarray(self.radar)
        return (self.resolution + self.spread * jnp.sqrt(away @ away + 1e-6)) * jnp.eye(2)


@mb.struct
class Crossing:
    """Measures the squared distance to the pier, and a danger near the rocks.

    Its expectation and variance under a belief are exact for the distance, which is quadratic, and
    integrated over the position for the danger.
    """

    goal: mb.ArrayField = mb.array(ndim=1)  # the pier, m
    effort: float = mb.number(gt=0)  # R
    w_obs: float = mb.number(ge=0)
    reach: float = mb.number(gt=0)  # m, of the danger

    @property
    def R(self) -> Array:
        return self.effort * jnp.eye(2)

    def base(self, x: Array) -> Array:
        return 0.5 * jnp.sum((x - jnp.asarray(self.goal)) ** 2)

    def penalty(self, x: Array, surroundings: mb.Surroundings) -> Array:
        return self.w_obs / (1.0 + jnp.exp(surroundings.clearance(x) / self.reach))

    def terminal(self, x: Array) -> Array:
        return 4.0 * self.base(x)
