"""A bank of extended Kalman filters, one for each mode of the prior (Alspach and Sorenson 1972).

    log w_i += log N(y - c(mu_i); 0, S_i),    S_i = C_i Sigma_i C_i' + R_s(mu_i)

with mu_i and Sigma_i predicted. The noise is taken at each component's own mean, so the term
log det S_i matters: where the noise depends on the state, the scatter of the measurements also
tells the modes apart.
"""

import jax
import jax.numpy as jnp
from jax import Array

from ..belief import kalman
from ..belief.gaussian import MixtureBelief, RootBelief
from ..belief.prior import prior_mixture
from ..numerics.square_root import log_normal_density
from ..problem import Problem
from ..structs import struct


@struct
class MixtureFilter:
    """Runs one EKF per mode of the prior and weighs them by the likelihood of the measurements.

    With a single mode it is the EKF.
    """

    def init(self, problem: Problem, key: Array) -> MixtureBelief:
        """Returns the prior, mode by mode."""
        return prior_mixture(problem)

    def update(
        self, problem: Problem, belief: MixtureBelief, u: Array, y: Array, key: Array
    ) -> MixtureBelief:
        """Updates each component by itself, then its weight by the measurement's likelihood."""

        def update_component(mean: Array, root: Array) -> tuple[RootBelief, Array]:
            predicted = kalman.predict(problem, RootBelief(mean, root), u)
            posterior, innovation, innovation_cov = kalman.correct(problem, predicted, y)
            return posterior, log_normal_density(innovation, innovation_cov)

        components, logs = jax.vmap(update_component)(belief.means, belief.roots)
        return MixtureBelief(components.mean, components.root, reweighted(belief.log_weights, logs))


def reweighted(log_weights: Array, log_likelihoods: Array) -> Array:
    """Returns normalised log-weights (m,) after a measurement.

    They stay as they were where the measurement is impossible under all components.
    """
    logs = log_weights + log_likelihoods
    usable = jnp.isfinite(logs)
    return jax.nn.log_softmax(
        jnp.where(usable.any(), jnp.where(usable, logs, -jnp.inf), log_weights)
    )
