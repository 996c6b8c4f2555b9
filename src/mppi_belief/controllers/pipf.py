"""PIPF: path integral control from every particle of a particle filter.

A simplification of Hoshino et al. (2025), as in the paper's footnote.

Not the "path integral particle filter" that goes by the same letters elsewhere: there path integral
control makes a better *filter*; here a filter's particles feed a *controller*.

From each of the K particles L paths are sampled about one common nominal, weighted as in CE-MPPI.
The particles' controls become one in one of two ways; the footnote fits both:

* `AverageOfParticles`: each particle's own path integral control, averaged by the particle's
  posterior weight, u = -R^-1 G' E[grad V(x)]. This is "per-particle path integral controllers",
  truer to Hoshino et al., and optimal if the state were seen from the next step on.
* `PooledPaths`: one softmax over all K L paths, each carrying its particle's posterior weight;
  particles from which the future is cheap then count for more.
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import jax
import jax.numpy as jnp
from jax import Array

from ..belief.particles import ParticleBelief
from ..planning.parts import PathCost, charged_parts
from ..planning.path_costs import CertaintyEquivalent
from ..planning.path_integral import accumulated_costs, rollouts
from ..planning.path_weights import CostedPaths, effective_sample_size, improve, weights
from ..planning.samplers import NominalSampler
from ..problem import Problem
from ..structs import number, size, struct


class PIPFInfo(NamedTuple):
    """Holds the diagnostics of one step."""

    ess: Array  # (): effective sample size over all paths
    weights: Array  # (K L,): of all paths, those of a particle together


class Combination(Protocol):
    """Says how the paths from all particles are weighted together."""

    def weights(self, costs: Array, log_weights: Array, temperature: Array | float) -> Array:
        """Returns normalised weights (K L,) for path costs (K, L) and log-weights (K,)."""


@struct
class AverageOfParticles:
    """Averages the particles' own controls by their posterior weights."""

    def weights(self, costs: Array, log_weights: Array, temperature: Array | float) -> Array:
        """Returns normalised weights (K L,) for path costs (K, L) and log-weights (K,)."""
        of_each = jax.vmap(weights, in_axes=(0, None))(costs, temperature)
        w = jnp.exp(log_weights)[:, None] * of_each
        total = jnp.sum(w)  # 1, less the particles from which no path has a finite cost
        return (w / jnp.where(total > 0, total, 1.0)).reshape(-1)


@struct
class PooledPaths:
    """Weights all paths by one softmax, each with its particle's posterior weight."""

    def weights(self, costs: Array, log_weights: Array, temperature: Array | float) -> Array:
        """Returns normalised weights (K L,) for path costs (K, L) and log-weights (K,)."""
        return weights((costs - temperature * log_weights[:, None]).reshape(-1), temperature)


@dataclass(frozen=True)
class ParticleWeighting:
    """Weights the paths of one belief as a combination says."""

    combination: Combination
    log_weights: Array  # (K,)
    temperature: Array | float

    def weights(self, costs: Array) -> Array:
        """Returns normalised weights (K L,) for path costs (K L,)."""
        by_particle = costs.reshape(len(self.log_weights), -1)
        return self.combination.weights(by_particle, self.log_weights, self.temperature)


@struct
class PIPF:
    """Plans from the particles of `filter=particle`.

    Raises:
        ValueError: for a sampler other than `NominalSampler`: others plan from one Gaussian
    """

    n_samples: int = size(default=200)  # L, per particle
    horizon: int = size(default=30)  # H, steps
    temperature: float = number(default=1.0, gt=0)  # lambda
    path_cost: PathCost = CertaintyEquivalent()  # of a state, which is known for certain
    sampler: NominalSampler = NominalSampler()  # where controls are drawn
    combination: Combination = AverageOfParticles()  # how the particles' paths are weighted

    def __post_init__(self) -> None:
        """Refuses samplers that plan from one Gaussian."""
        if not isinstance(self.sampler, NominalSampler):
            raise ValueError(
                "sampler must be a NominalSampler: PIPF plans from particles, "
                "other samplers from one Gaussian"
            )

    def init(self, problem: Problem) -> Array:
        """Returns the zero nominal (H, nu)."""
        return jnp.zeros((self.horizon, problem.cost.R.shape[0]))

    def act(
        self, problem: Problem, belief: ParticleBelief, plan: Array, key: Array
    ) -> tuple[Array, Array, PIPFInfo]:
        """Returns the control (nu,), the nominal of the next step (H, nu) and diagnostics.

        Raises:
            TypeError: for a belief without particles
        """
        if not isinstance(belief, ParticleBelief):
            raise TypeError("controller pipf plans from particles: use filter=particle")
        total = belief.particles.shape[-1] * self.n_samples
        starts = jnp.repeat(belief.particles, self.n_samples, axis=-1, total_repeat_length=total)
        draw = self.sampler.around(problem, plan, self.temperature)

        def sample(key: Array, n: int) -> CostedPaths:
            drawn = draw(key, n)
            states = rollouts(problem, starts, plan[:, :, None] + drawn.increments)
            costs = self._state_costs(problem, starts, states)
            return CostedPaths(drawn.increments, costs + drawn.correction, states)

        weighting = ParticleWeighting(self.combination, belief.log_weights, self.temperature)
        improved = improve(plan, sample, key, total, weighting)
        info = PIPFInfo(effective_sample_size(improved.weights), improved.weights)
        return improved.controls[0], self.sampler.warm_start(improved.controls), info

    def _state_costs(self, problem: Problem, starts: Array, states: Array) -> Array:
        """Returns the costs (K L,) of paths of states (H, nx, K L) from starts (nx, K L)."""
        nx = len(starts)
        certain = jnp.zeros((self.horizon + 1, nx, nx))
        return accumulated_costs(
            problem,
            starts,
            states,
            certain,
            charged_parts(self.path_cost),
            lambda x, cov: self.path_cost.running(problem, x, cov),
            lambda x, cov: self.path_cost.terminal(problem, x, cov),
        )
