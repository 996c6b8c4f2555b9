"""Path integral control in belief space (Sec. V and VI): sampled means, path costs, weights, control.

    mu_{k+1} = mu_k + (f(mu_k) + G u_k) dt + L_k eps_k,   eps_k ~ N(0, I dt)           (18)
    S        = sum_k q_k(mu_k) dt + phi(mu_H) + sum_k nominal_k' R delta_k dt
    w        = exp(-S / lambda) / sum exp(-S / lambda)
    u_0      = nominal_0 + sum_i w_i delta_0^(i)                                      (19)

with the control increment delta_k = R^-1 G' (G R^-1 G')^+ L_k eps_k / dt. Two choices of L:

* innovation: L_k L_k' = D_k, what the measurements will do to the mean. With a zero nominal this is
  Algorithm 1 as printed.
* matched: L_k L_k' = lambda G R^-1 G', the matching condition imposed; then L_k eps_k = G delta_k dt,
  so the noise enters through the control channel about a warm-started nominal, as in MPPI.

The last term of S is Girsanov's, for sampling about a nominal that is not zero (its part that is the
same for all samples cancels in the weights).

Sampled arrays keep the sample as their last axis: (H, nu, N), (H, nx, N); costs and weights are (N,).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jax import Array

from ..discretise import euler_step
from ..numerics.normals import standard_normal
from ..numerics.vmap_last import vmap_last
from ..problem import Problem

BLOCK = 2000  # samples whose arrays stay in the cache of a CPU's core


def control_map(G: Array, R: Array) -> Array:
    """R^-1 G' (G R^-1 G')^+ (nu, nx), the pseudoinverse taken on the range of G (Theorem 6)."""
    weighted = jnp.linalg.solve(R, G.T)
    return weighted @ jnp.linalg.pinv(G @ weighted, hermitian=True)


def normals(key: Array, shape: tuple[int, int, int], antithetic: bool) -> Array:
    """Standard normals (H, dim, N), the second half of the samples the mirror image of the first if antithetic."""
    if not antithetic:
        return standard_normal(key, shape)
    half = standard_normal(key, (*shape[:2], (shape[2] + 1) // 2))
    return jnp.concatenate([half, -half], axis=-1)[..., : shape[2]]


def matched_increments(
    problem: Problem, normals: Array, temperature: Array | float, std: Array | float | None
) -> Array:
    """Control increments delta (H, nu, N) from normals (H, nu, N).

    Their covariance is std^2 I or, for None, lambda R^-1 / dt, with which G delta dt = L eps has
    exactly the matched diffusion lambda G R^-1 G'.
    """
    if std is not None:
        return std * normals
    factor = jnp.linalg.cholesky(jnp.linalg.inv(problem.cost.R) * temperature / problem.dt)
    return jnp.einsum("ij,hjn->hin", factor, normals)


def girsanov_weight(
    problem: Problem,
    temperature: Array | float,
    std: Array | float | None,
    alpha: Array | float | None,
) -> Array:
    """The matrix W (nu, nu) of `girsanov`.

    R dt in theory; gamma S_u^-1 with gamma = lambda (1 - alpha) for increments of covariance
    S_u = std^2 I and a given alpha (Williams et al. 2018), which agrees for S_u = lambda R^-1 / dt, alpha = 0.
    """
    R = problem.cost.R
    if alpha is None:
        return R * problem.dt
    if std is None:
        return (1 - alpha) * R * problem.dt
    return temperature * (1 - alpha) / std**2 * jnp.eye(len(R))


def receded(nominal: Array) -> Array:
    """The nominal (H, nu) one step later, padded with no control."""
    return jnp.concatenate([nominal[1:], jnp.zeros_like(nominal[:1])])


def rollouts(
    problem: Problem, mean: Array, controls: Array, disturbance: Array | None = None
) -> Array:
    """Means mu_1..mu_H (H, nx, N) from one mean (nx,) or N of them (nx, N), for controls (H, nu, N) and
    a disturbance (H, nx, N)."""
    move = vmap_last(
        lambda mu, u: euler_step(problem.system, mu, u, problem.dt), mapped=(True, True)
    )

    def advance(mu: Array, drive: tuple[Array, Array | None]) -> tuple[Array, Array]:
        u, pushed = drive
        mu = move(mu, u) if pushed is None else move(mu, u) + pushed
        return mu, mu

    return jax.lax.scan(advance, _columns(mean, controls.shape[-1]), (controls, disturbance))[1]


def _columns(mean: Array, n_samples: int) -> Array:
    return mean if mean.ndim > 1 else jnp.broadcast_to(mean[:, None], (len(mean), n_samples))


def accumulated_costs(
    problem: Problem,
    mean: Array,
    means: Array,
    covs: Array,
    at_step_end: bool,
    running: Callable[[Array, Array], Array],
    terminal: Callable[[Array, Array], Array],
) -> Array:
    """Returns sum_k q dt + phi (N,) of paths along planned covariances.

    Args:
        problem: the problem, for its time step
        mean: (nx,) where all paths start, or (nx, N)
        means: (H, nx, N) means at t_1..t_H
        covs: (H+1, nx, nx) covariances at t_0..t_H
        at_step_end: whether q of step k is taken at t_{k+1}, where the control has led to, or else
            at t_k as in Algorithm 1 as printed
        running: maps one mean (nx,) and covariance (nx, nx) to a cost per second ()
        terminal: maps the same to a cost ()
    """
    if at_step_end:
        charged_means = means
        charged_covs = covs[1:]
    else:
        first = _columns(mean, means.shape[-1])[None]
        charged_means = jnp.concatenate([first, means[:-1]])
        charged_covs = covs[:-1]
    over_paths = jax.vmap(running, in_axes=(-1, None), out_axes=-1)
    rates = jax.vmap(over_paths)(charged_means, charged_covs)
    last = jax.vmap(terminal, in_axes=(-1, None), out_axes=-1)(means[-1], covs[-1])
    return jnp.full(len(rates), problem.dt) @ rates + last


def girsanov(nominal: Array, increments: Array, weight: Array) -> Array:
    """sum_k nominal_k' W delta_k (N,) for nominal (H, nu), increments (H, nu, N), W of `girsanov_weight`."""
    return jnp.tensordot(nominal @ weight, increments, axes=2)


def weights(costs: Array, temperature: Array | float) -> Array:
    """Normalised importance weights (N,), by log-sum-exp; a path whose cost is not finite weighs nothing,
    so all are zero if none is finite. The least cost is taken off before the division, which may overflow."""
    usable = jnp.isfinite(costs)
    least = jnp.min(jnp.where(usable, costs, jnp.inf))
    w = jnp.where(usable, jnp.exp((least - costs) / temperature), 0.0)
    return w / jnp.maximum(jnp.sum(w), 1.0)  # the least cost alone has 1


def effective_sample_size(w: Array) -> Array:
    """1 / sum w^2 () for normalised weights (N,); 0 if no path weighs anything."""
    total = jnp.sum(w * w)
    return jnp.where(total > 0, 1.0 / total, 0.0)


def log_desirability(costs: Array, temperature: Array | float) -> Array:
    """log of the Monte Carlo estimate of Psi(t, mu) (17) (): the sample mean of exp(-S / lambda)."""
    return -free_energy(costs, temperature) / temperature


def free_energy(costs: Array, temperature: Array | float) -> Array:
    """-lambda log of the same (), inf if no cost is finite."""
    least = jnp.min(costs)
    some = jnp.isfinite(least)
    spread = jnp.mean(jnp.exp((jnp.where(some, least, 0.0) - costs) / temperature))
    return jnp.where(some, least - temperature * jnp.log(jnp.where(some, spread, 1.0)), jnp.inf)


def weighted_increments(w: Array, increments: Array) -> Array:
    """sum_i w_i delta^(i) (H, nu), the whole horizon of (19)."""
    return increments @ w


class Weighting(Protocol):
    """Turns the costs of paths into their weights."""

    def weights(self, costs: Array) -> Array:
        """Returns normalised weights (N,) for path costs (N,); all are zero if no cost is finite."""


@runtime_checkable
class BlockWeighting(Weighting, Protocol):
    """Weights samples block by block with the same result as together."""

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
    """Sampled paths with what they cost."""

    increments: Array  # (H, nu, N): controls less those of the nominal
    costs: Array  # (N,): path costs S, the correction for their density included
    means: Array  # (H, nx, N): belief means along them


class ImprovedPlan(NamedTuple):
    """A plan improved by sampled paths."""

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
    time, where the weighting allows that. A single block, as always on a GPU, uses the key as it is.

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
    """Weights each block by itself and lets it count by its own estimate of Psi."""
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
