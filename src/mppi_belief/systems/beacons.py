"""A unicycle that measures distance and direction of known beacons, worse the farther they are.

    p_x' = v cos h,  p_y' = v sin h,  h' = u_1 + sigma_h w_1',  v' = u_2 + sigma_v w_2'
    y_j  = [|b_j - p|, angle of b_j - p, less h] + noise with deviations floor + slope |b_j - p|

State [p_x, p_y, h, v] in m, rad, m/s; controls a turn rate in rad/s and an acceleration in m/s^2;
measurements [distance, bearing] in m and rad, one beacon after another. How nonlinear they are is
`curvature`: with kappa the beacons stand at z + (b_j - z) / kappa, seen from the anchor z in the
same direction,

    c_kappa(p) = c(z) + (c(z + kappa (p - z)) - c(z)) / kappa

so that value and gradient at z are the same for all kappa, and so is the information that they give
there. kappa = 1 is the sensor itself, kappa = 0 its linearisation at z. Deviations are those at the
beacons' true distances for every kappa.
"""

import jax.numpy as jnp
from jax import Array

from ..structs import ArrayField, array, number, struct


@struct
class Beacons:
    """Represents a unicycle among n beacons; c has no derivative at a beacon."""

    beacons: ArrayField = array(ndim=2)  # b_j (n, 2), m
    anchor: ArrayField = array(ndim=1)  # z (2,), m
    turn_noise: float = number(ge=0)  # sigma_h, rad/s^0.5
    speed_noise: float = number(ge=0)  # sigma_v, m/s^1.5
    distance_floor: float = number(gt=0)  # m
    distance_slope: float = number(ge=0)  # m/m
    bearing_floor: float = number(gt=0)  # rad
    bearing_slope: float = number(ge=0)  # rad/m
    curvature: float = number(default=1.0, ge=0)  # kappa

    state_labels = ("$p_x$ (m)", "$p_y$ (m)", "heading (rad)", "speed (m/s)")

    @property
    def measurement_units(self) -> tuple[str, ...]:
        """Returns the units (2 n,) of distances and bearings."""
        return ("m", "rad") * len(self.beacons)

    @property
    def H(self) -> Array:
        deviations = [jnp.asarray(self.turn_noise, float), jnp.asarray(self.speed_noise, float)]
        return jnp.vstack([jnp.zeros((2, 2)), jnp.diag(jnp.stack(deviations))])

    def f(self, x: Array) -> Array:
        zero = jnp.zeros_like(x[0])
        return jnp.stack([x[3] * jnp.cos(x[2]), x[3] * jnp.sin(x[2]), zero, zero])

    def G(self, x: Array) -> Array:
        return jnp.vstack([jnp.zeros((2, 2)), jnp.eye(2)])

    def c(self, x: Array) -> Array:
        """Returns distances and bearings (2 n,).

        Distances are taken without division by kappa and angles by one atan2, so that nothing
        cancels however small kappa is.
        """
        kappa = self.curvature
        D = jnp.asarray(self.beacons) - jnp.asarray(self.anchor)
        s = x[:2] - jnp.asarray(self.anchor)
        offsets = D - kappa * s

        # d0 + (d - d0) / kappa with d^2 - d0^2 written out.
        d = jnp.sqrt(jnp.sum(offsets**2, axis=1))
        d0 = jnp.sqrt(jnp.sum(D**2, axis=1))
        distance = d0 + (kappa * (s @ s) - 2 * D @ s) / (d + d0)

        # The angle between D and D - kappa s, over kappa.
        across = D[:, 1] * s[0] - D[:, 0] * s[1]
        along = jnp.sum(D * offsets, axis=1)
        angle = jnp.arctan2(kappa * across, along) / _or_one(kappa)
        change = jnp.where(kappa > 0, angle, across / d0**2)
        bearing = jnp.arctan2(D[:, 1], D[:, 0]) + change - x[2]
        return jnp.ravel(jnp.stack([distance, bearing], axis=1))

    def difference(self, y: Array, predicted: Array) -> Array:
        """Returns y - predicted (2 n,), bearings within half a period 2 pi / kappa of zero."""
        differences = jnp.reshape(y - predicted, (-1, 2))
        period = 2 * jnp.pi / _or_one(self.curvature)
        whole_periods = period * jnp.round(differences[:, 1] / period)
        surplus = jnp.where(jnp.asarray(self.curvature) > 0, whole_periods, 0.0)
        return jnp.ravel(jnp.stack([differences[:, 0], differences[:, 1] - surplus], axis=1))

    def sigma_o(self, x: Array) -> Array:
        distances = jnp.sqrt(jnp.sum((jnp.asarray(self.beacons) - x[:2]) ** 2, axis=1))
        deviations = (
            self.distance_floor + self.distance_slope * distances,
            self.bearing_floor + self.bearing_slope * distances,
        )
        return jnp.diag(jnp.ravel(jnp.stack(deviations, axis=1)))


def _or_one(kappa: Array | float) -> Array:
    """Returns kappa (), or 1 where it is 0 and the quotient by it is not used."""
    return jnp.where(jnp.asarray(kappa) > 0, kappa, 1.0)
