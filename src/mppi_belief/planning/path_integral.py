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
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ..discretise import euler_step
from ..numerics.normals import standard_normal
from ..numerics.vmap_last import vmap_last
from ..problem import Problem

BLOCK = 2000  # samples whose arrays stay in the cache of a CPU's core


class PlanInfo(NamedTuple):
    """Diagnostics of one step: effective sample size (), state cost of the nominal it started from (),
    planned covariances (H+1, nx, nx), sampled means (H, nx, N) and their weights (N,)."""

    ess: Array
    nominal_cost: Array
    planned_cov: Array
    means: Array
    weights: Array


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


def path_costs(
    problem: Problem,
    mean: Array,
    means: Array,
    covs: Array,
    charge: str,
    running: Callable[[Array, Array], Array],
    terminal: Callable[[Array, Array], Array],
) -> Array:
    """sum_k q dt + phi (N,) for means (H, nx, N) that left `mean`, along covs (H+1, nx, nx).

    `charge` is the end of each step at which q is taken: "start" is Algorithm 1 as printed (q at mu_k),
    "end" the state that the control led to. `running` and `terminal` map one mean (nx,) and covariance
    (nx, nx) to a cost ().
    """
    if charge == "start":
        charged, at = (
            jnp.concatenate([_columns(mean, means.shape[-1])[None], means[:-1]]),
            covs[:-1],
        )
    else:
        charged, at = means, covs[1:]
    rates = jax.vmap(jax.vmap(running, in_axes=(-1, None), out_axes=-1))(charged, at)
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


def weighted_in_blocks(
    sample: Callable[[Array, int], tuple[Array, Array, Array]],
    key: Array,
    n: int,
    temperature: Array | float,
) -> tuple[Array, Array, Array]:
    """sum_i w_i delta^(i) (H, nu), the weights w (n,) and the means (H, nx, n) of n samples, at most BLOCK at a time.

    `sample(key, size)` returns increments (H, nu, size), path costs (size,) and means (H, nx, size). Each block is
    weighted by itself and counts by its own estimate of Psi, which is the same as weighting all samples
    together. One block, as always on a GPU, uses the key as it is.
    """
    count = -(-n // BLOCK) if jax.default_backend() == "cpu" else 1
    size = -(-n // count)

    def block(key: Array, wanted: Array | int) -> tuple[Array, Array, Array, Array]:
        increments, costs, means = sample(key, size)
        usable = jnp.isfinite(costs) & (jnp.arange(size) < wanted)
        costs = jnp.where(usable, costs, jnp.inf)
        w = weights(costs, temperature)
        return weighted_increments(w, increments), w, free_energy(costs, temperature), means

    if count == 1:
        change, w, _, means = block(key, n)
        return change, w, means
    keys, left = jax.random.split(key, count), n - size * jnp.arange(count)
    changes, w, energies, means = jax.lax.map(lambda given: block(*given), (keys, left))
    share = weights(energies, temperature)
    joined = jnp.moveaxis(means, 0, -2).reshape(*means.shape[1:-1], -1)
    return jnp.tensordot(share, changes, 1), (share[:, None] * w).reshape(-1)[:n], joined[..., :n]
