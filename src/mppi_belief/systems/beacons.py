"""A unicycle that measures distance and direction of known beacons, worse the farther they are.

    p_x' = v cos h,  p_y' = v sin h,  h' = u_1 + sigma_h w_1',  v' = u_2 + sigma_v w_2'
    y_j  = [|b_j - p|, angle of b_j - p, less h] + noise with deviations floor + slope |b_j - p|

State [p_x, p_y, h, v] in m, rad, m/s; controls a turn rate in rad/s and an acceleration in m/s^2; measurements
[distance, bearing] in m and rad, one beacon after another. How strongly they bend is `curvature`: with kappa the
beacons stand at z + (b_j - z) / kappa, seen from the anchor z in the same direction,

    c_kappa(p) = c(z) + (c(z + kappa (p - z)) - c(z)) / kappa

so that value and slope at z, and what they tell there, are the same for all kappa: kappa = 1 is the sensor
itself, kappa = 0 its linearisation at z. Deviations are those at the beacons' true distances, whatever kappa.
"""

import jax.numpy as jnp
from jax import Array

from ..structs import ArrayField, array, number, struct


@struct
class Beacons:
    """A unicycle among n beacons (n, 2); c has no derivative at a beacon."""

    beacons: ArrayField = array(ndim=2)  # b_j, m
    anchor: ArrayField = array(ndim=1)  # z (2,), m
    turn_noise: float = number(ge=0)  # sigma_h, rad/s^0.5
    speed_noise: float = number(ge=0)  # sigma_v, m/s^1.5
    distance_floor: float = number(gt=0)  # m
    distance_slope: float = number(ge=0)
    bearing_floor: float = number(gt=0)  # rad
    bearing_slope: float = number(ge=0)  # rad/m
    curvature: float = number(default=1.0, ge=0)  # kappa

    @property
    def H(self) -> Array:
        moved = jnp.diag(
            jnp.stack([jnp.asarray(self.turn_noise, float), jnp.asarray(self.speed_noise, float)])
        )
        return jnp.vstack([jnp.zeros((2, 2)), moved])

    def f(self, x: Array) -> Array:
        still = jnp.zeros_like(x[0])
        return jnp.stack([x[3] * jnp.cos(x[2]), x[3] * jnp.sin(x[2]), still, still])

    def G(self, x: Array) -> Array:
        return jnp.vstack([jnp.zeros((2, 2)), jnp.eye(2)])

    def c(self, x: Array) -> Array:
        """Distances without division by kappa, angles by one atan2: nothing cancels however small kappa is."""
        kappa, D = self.curvature, jnp.asarray(self.beacons) - jnp.asarray(self.anchor)
        s = x[:2] - jnp.asarray(self.anchor)
        left = D - kappa * s
        d, d0 = jnp.sqrt(jnp.sum(left**2, axis=1)), jnp.sqrt(jnp.sum(D**2, axis=1))
        distance = d0 + (kappa * (s @ s) - 2 * D @ s) / (d + d0)
        across, along = D[:, 1] * s[0] - D[:, 0] * s[1], jnp.sum(D * left, axis=1)
        bent = jnp.where(
            kappa > 0, jnp.arctan2(kappa * across, along) / _or_one(kappa), across / d0**2
        )
        return jnp.ravel(jnp.stack([distance, jnp.arctan2(D[:, 1], D[:, 0]) + bent - x[2]], axis=1))

    def difference(self, y: Array, predicted: Array) -> Array:
        """y - predicted, bearings to within half a period 2 pi / kappa of zero."""
        off, turn = jnp.reshape(y - predicted, (-1, 2)), 2 * jnp.pi / _or_one(self.curvature)
        nearest = jnp.where(
            jnp.asarray(self.curvature) > 0, turn * jnp.round(off[:, 1] / turn), 0.0
        )
        return jnp.ravel(jnp.stack([off[:, 0], off[:, 1] - nearest], axis=1))

    def sigma_o(self, x: Array) -> Array:
        far = jnp.sqrt(jnp.sum((jnp.asarray(self.beacons) - x[:2]) ** 2, axis=1))
        deviations = (
            self.distance_floor + self.distance_slope * far,
            self.bearing_floor + self.bearing_slope * far,
        )
        return jnp.diag(jnp.ravel(jnp.stack(deviations, axis=1)))


def _or_one(kappa: Array | float) -> Array:
    """kappa (), or 1 where it is 0 and what is divided by it is not used."""
    return jnp.where(jnp.asarray(kappa) > 0, kappa, 1.0)
