"""A bank of extended Kalman filters, one for each mode of the prior (Alspach and Sorenson 1972).

    log w_i += log N(y - c(mu_i); 0, S_i),    S_i = C_i Sigma_i C_i' + R_s(mu_i)

with mu_i and Sigma_i predicted. Noise is taken at each component's own mean, so log det S_i counts: where the noise
depends on the state, how far the measurements scatter tells the modes apart, too.
"""

import jax
import jax.numpy as jnp
from jax import Array

from ..belief import kalman as gaussian
from ..belief.gaussian import MixtureBelief, RootBelief, prior_mixture
from ..discretise import measurement_cov
from ..numerics.linalg import decorrelated
from ..problem import Problem
from ..structs import struct


@struct
class MixtureFilter:
    """As many components as the prior has modes; of one, it is the EKF."""

    def init(self, problem: Problem, key: Array) -> MixtureBelief:
        return prior_mixture(problem)

    def update(
        self, problem: Problem, belief: MixtureBelief, u: Array, y: Array, key: Array
    ) -> MixtureBelief:
        """Each component by itself, then weighed by how likely it held the measurement."""

        def one(mean: Array, root: Array) -> tuple[RootBelief, Array]:
            predicted = gaussian.predict(problem, RootBelief(mean, root), u)
            return gaussian.correct(problem, predicted, y), log_likelihood(problem, predicted, y)

        components, logs = jax.vmap(one)(belief.means, belief.roots)
        return MixtureBelief(components.mean, components.root, reweighted(belief.log_weights, logs))


def log_likelihood(problem: Problem, predicted: RootBelief, y: Array) -> Array:
    """log N(y - c(mu); 0, S) () up to a constant, for the measurement y (ny,) of a predicted belief."""
    mean, system = predicted.mean, problem.system
    seen = jax.jacfwd(system.c)(mean) @ predicted.root
    S = seen @ seen.T + measurement_cov(system, mean, problem.dt)
    innovation, variances = decorrelated((y - system.c(mean))[:, None], S)
    spread = jnp.stack(variances)
    return -0.5 * jnp.sum(innovation[:, 0] ** 2 / spread + jnp.log(spread))


def reweighted(log_weights: Array, log_likelihoods: Array) -> Array:
    """Normalised log-weights (m,); as they were where the measurement is beyond all components."""
    logs = log_weights + log_likelihoods
    usable = jnp.isfinite(logs)
    return jax.nn.log_softmax(
        jnp.where(usable.any(), jnp.where(usable, logs, -jnp.inf), log_weights)
    )
