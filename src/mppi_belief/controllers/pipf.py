"""PIPF: a particle filter with path integral control from every particle (Hoshino et al. 2025, simplified).

Not the "path integral particle filter" that goes by the same letters elsewhere: there path integral
control makes a better *filter*; here a filter's particles feed a *controller*.

From each of the K particles L paths are sampled about one common nominal, weighted as in CE-MPPI.
`combine` says how the particles' controls become one:

* "average": each particle's own path integral control, averaged by the particle's posterior weight,
  u = -R^-1 G' E[grad V(x)]. This is "per-particle path integral controllers", truer to Hoshino et al.,
  and optimal if the state were seen from the next step on.
* "pooled": one softmax over all K L paths, each carrying its particle's posterior weight; particles
  from which the future is cheap then count for more. The paper's footnote fits both.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ..belief.cost import certainty_equivalent
from ..belief.particles import ParticleBelief
from ..planning import path_integral as pi
from ..problem import Problem
from ..structs import choice, number, size, struct


class PIPFInfo(NamedTuple):
    """Diagnostics: effective sample size over all paths () and their weights (K L,)."""

    ess: Array
    weights: Array


@struct
class PIPF:
    """Needs `filter=particle`. Settings as in `MPPIBelief`; `n_samples` is L, per particle."""

    n_samples: int = size(200)
    horizon: int = size(30)
    temperature: float = number(1.0, gt=0)
    control_std: float | None = number(None, gt=0, optional=True)
    alpha: float | None = number(None, ge=0, le=1, optional=True)
    antithetic: bool = choice(False, True)
    combine: str = choice("average", "pooled")
    charge: str = choice("end", "start")

    def init(self, problem: Problem) -> Array:
        """The zero nominal (H, nu)."""
        return jnp.zeros((self.horizon, problem.cost.R.shape[0]))

    def act(
        self, problem: Problem, belief: ParticleBelief, plan: Array, key: Array
    ) -> tuple[Array, Array, PIPFInfo]:
        """The control (nu,), the nominal shifted by one step (H, nu), diagnostics."""
        if not isinstance(belief, ParticleBelief):
            raise TypeError("controller pipf plans from particles: use filter=particle")
        n_particles = belief.particles.shape[-1]
        normals = pi.normals(
            key, (self.horizon, plan.shape[1], n_particles * self.n_samples), self.antithetic
        )
        increments = pi.matched_increments(problem, normals, self.temperature, self.control_std)
        starts = jnp.repeat(
            belief.particles, self.n_samples, axis=-1, total_repeat_length=increments.shape[-1]
        )
        costs = self._costs(problem, starts, plan[:, :, None] + increments)
        weight = pi.girsanov_weight(problem, self.temperature, self.control_std, self.alpha)
        costs += pi.girsanov(plan, increments, weight)
        w = self._weights(costs.reshape(n_particles, self.n_samples), belief.log_weights)
        improved = plan + pi.weighted_increments(w, increments)
        return improved[0], pi.receded(improved), PIPFInfo(pi.effective_sample_size(w), w)

    def _costs(self, problem: Problem, starts: Array, controls: Array) -> Array:
        """Path costs (K L,) from states (nx, K L), the penalty at the state."""
        states = pi.rollouts(problem, starts, controls)
        certain = jnp.zeros((self.horizon + 1, *(starts.shape[0],) * 2))
        return pi.path_costs(
            problem,
            starts,
            states,
            certain,
            self.charge,
            lambda x, _: certainty_equivalent(problem, x),
            lambda x, _: problem.cost.terminal(x),
        )

    def _weights(self, costs: Array, log_weights: Array) -> Array:
        """Normalised weights of all paths (K L,) from costs (K, L) and the particles' log-weights (K,)."""
        if self.combine == "pooled":
            return pi.weights(
                (costs - self.temperature * log_weights[:, None]).reshape(-1), self.temperature
            )
        of_each = jax.vmap(pi.weights, in_axes=(0, None))(costs, self.temperature)
        w = jnp.exp(log_weights)[:, None] * of_each
        total = jnp.sum(w)  # 1, less the particles from which no path has a finite cost
        return (w / jnp.where(total > 0, total, 1.0)).reshape(-1)
