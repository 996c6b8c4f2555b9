"""The weights of sampled paths, and the plan that they improve (Sec. VI).

    w      = exp(-S / lambda) / sum exp(-S / lambda)
    u      = nominal + sum_i w_i delta^(i)                                            (19)
    Psi    = E exp(-S / lambda)                                                       (17)

Symbols: H steps of the horizon, N samples, nx states, nu controls. Sampled arrays keep the sample
as their last axis.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jax import Array

BLOCK = 2000  # samples whose arrays stay in the cache of a CPU's core


def weights(costs: Array, temperature: Array | float) -> Array:
    """Returns normalised importance weights (N,) for path costs (N,).

    A path whose cost is not finite weighs nothing, so all weights are zero if no cost is finite.
    The least cost is subtracted before the division, which may overflow.
    """
    usable = jnp.isfinite(costs)
    least = jnp.min(jnp.where(usable, costs, jnp.inf))
    w = jnp.where(usable, jnp.exp((least - costs) / temperature), 0.0)
    return w / jnp.maximum(jnp.sum(w), 1.0)  # the least cost alone has 1


def effective_sample_size(w: Array) -> Array:
    """Returns 1 / sum w^2 () for normalised weights (N,); 0 if no path weighs anything."""
    total = jnp.sum(w * w)
    return jnp.where(total > 0, 1.0 / total, 0.0)


def log_desirability(costs: Array, temperature: Array | float) -> Array:
    """Returns the log () of the estimate of Psi (17), the sample mean of exp(-S / lambda)."""
    return -free_energy(costs, temperature) / temperature


def free_energy(costs: Array, temperature: Array | float) -> Array:
    """Returns -lambda log of the estimate of Psi () for path costs (N,); inf if none is finite."""
    least = jnp.min(costs)
    usable = jnp.isfinite(least)
    mean = jnp.mean(jnp.exp((jnp.where(usable, least, 0.0) - costs) / temperature))
    return jnp.where(usable, least - temperature * jnp.log(jnp.where(usable, mean, 1.0)), jnp.inf)


def weighted_increments(w: Array, increments: Array) -> Array:
    """Returns sum_i w_i delta^(i) (H, nu), the whole horizon of (19), for delta (H, nu, N)."""
    return increments @ w


class Weighting(Protocol):
    """Turns the costs of paths into their weights."""

    def weights(self, costs: Array) -> Array:
        """Returns normalised weights (N,) for path costs (N,), all zero if no cost is finite."""


@runtime_checkable
class BlockWeighting(Weighting, Protocol):
    """Weights samples block by block, with the same result as all of them at once."""

    def free_energy(self, costs: Array) -> Array:
        """Returns the cost () at which a block counts for all its paths (N,) together."""


@dataclass(frozen=True)
class Exponential:
    """Weights paths by exp(-S / lambda), as (19) does."""

    temperature: Array | float

    def weights(self, costs: Array) -> Array:
        """Returns normalised weights (N,) for path costs (N,)."""
        return weights(costs, self.temperature)

    def free_energy(self, costs: Array) -> Array:
        """Returns -lambda log of the estimate of Psi () from path costs (N,)."""
        return free_energy(costs, self.temperature)


class CostedPaths(NamedTuple):
    """Holds sampled paths with what they cost."""

    increments: Array  # (H, nu, N): controls less those of the nominal
    costs: Array  # (N,): path costs S, the correction for their density included
    means: Array  # (H, nx, N): belief means along them


class ImprovedPlan(NamedTuple):
    """Holds a plan improved by sampled paths."""

    controls: Array  # (H, nu)
    weights: Array  # (N,): of the sampled paths
    means: Array  # (H, nx, N): belief means along them


def improve(
    nominal: Array,
    sample: Callable[[Array, int], CostedPaths],
    key: Array,
    n: int,
    weighting: Weighting,
) -> ImprovedPlan:
    """Returns nominal + sum_i w_i delta^(i), (19) over the whole horizon, from n sampled paths.

    Every sampling planner improves its plan here. On a CPU at most BLOCK samples are drawn at a
    time, where the weighting allows that. A single block, as always on a GPU, uses the key itself.

    Args:
        nominal: (H, nu)
        sample: maps a key and a number of samples to that many paths
        key: of all samples
        n: the number of samples
        weighting: turns costs into weights
    """
    if isinstance(weighting, BlockWeighting) and n > BLOCK and jax.default_backend() == "cpu":
        return _improve_in_blocks(nominal, sample, key, n, weighting)
    increments, costs, means = sample(key, n)
    w = weighting.weights(costs)
    return ImprovedPlan(nominal + weighted_increments(w, increments), w, means)


def _improve_in_blocks(
    nominal: Array,
    sample: Callable[[Array, int], CostedPaths],
    key: Array,
    n: int,
    weighting: BlockWeighting,
) -> ImprovedPlan:
    """Weights the samples within each block, and the blocks by their estimates of Psi."""
    count = -(-n // BLOCK)
    size = -(-n // count)

    def block(key: Array, wanted: Array) -> tuple[Array, Array, Array, Array]:
        increments, costs, means = sample(key, size)
        usable = jnp.isfinite(costs) & (jnp.arange(size) < wanted)
        costs = jnp.where(usable, costs, jnp.inf)
        w = weighting.weights(costs)
        return weighted_increments(w, increments), w, weighting.free_energy(costs), means

    # The surplus samples of the last block are not wanted.
    keys = jax.random.split(key, count)
    wanted = n - size * jnp.arange(count)
    changes, w, energies, means = jax.lax.map(lambda args: block(*args), (keys, wanted))

    # Join the blocks.
    share = weighting.weights(energies)
    improved = nominal + jnp.tensordot(share, changes, 1)
    all_weights = (share[:, None] * w).reshape(-1)[:n]
    all_means = jnp.moveaxis(means, 0, -2).reshape(*means.shape[1:-1], -1)[..., :n]
    return ImprovedPlan(improved, all_weights, all_means)
