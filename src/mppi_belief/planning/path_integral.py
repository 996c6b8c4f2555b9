"""Sampled paths of the belief mean and what they cost (Sec. V and VI).

    mu_{k+1} = mu_k + (f(mu_k) + G u_k) dt + L_k eps_k,   eps_k ~ N(0, I dt)           (18)
    S        = sum_k q_k(mu_k) dt + phi(mu_H) + sum_k nominal_k' R delta_k dt

with the control increment delta_k = R^-1 G' (G R^-1 G')^+ L_k eps_k / dt. Two choices of L:

* innovation: L_k L_k' = D_k, what the measurements will do to the mean. With a zero nominal this is
  Algorithm 1 as printed.
* matched: L_k L_k' = lambda G R^-1 G', the matching condition imposed. Then L_k eps_k is
  G delta_k dt: the noise enters through the control channel about a warm-started nominal, as in
  MPPI.

The last term of S is Girsanov's, for sampling about a nominal that is not zero (its part that is
the same for all samples cancels in the weights). What the costs make of the paths is in
`path_weights`.

Symbols: H steps of the horizon, N samples, nx states, nu controls. Sampled arrays keep the sample
as their last axis: (H, nu, N), (H, nx, N); costs are (N,).
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import Array

from ..discretise import euler_step
from ..numerics.normals import standard_normal
from ..numerics.vmap_last import vmap_last
from ..problem import Problem


def control_map(G: Array, R: Array) -> Array:
    """Returns R^-1 G' (G R^-1 G')^+ (nu, nx) for G (nx, nu) and R (nu, nu).

    The pseudoinverse is taken on the range of G (Theorem 6).
    """
    weighted = jnp.linalg.solve(R, G.T)
    return weighted @ jnp.linalg.pinv(G @ weighted, hermitian=True)


def normals(key: Array, shape: tuple[int, int, int], antithetic: bool) -> Array:
    """Draws standard normals of shape (H, dim, N).

    With `antithetic` the second half of the samples is the mirror image of the first.
    """
    if not antithetic:
        return standard_normal(key, shape)
    horizon, dim, n = shape
    half = standard_normal(key, (horizon, dim, (n + 1) // 2))
    return jnp.concatenate([half, -half], axis=-1)[..., :n]


def matched_increments(
    problem: Problem, normals: Array, temperature: Array | float, std: Array | float | None
) -> Array:
    """Returns control increments delta (H, nu, N) from normals (H, nu, N).

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
    """Returns the matrix W (nu, nu) of `girsanov`.

    It is R dt in theory, and gamma S_u^-1 with gamma = lambda (1 - alpha) for increments of
    covariance S_u = std^2 I and a given alpha (Williams et al. 2018). Both agree for alpha = 0
    and S_u = lambda R^-1 / dt.
    """
    R = problem.cost.R
    if alpha is None:
        return R * problem.dt
    if std is None:
        return (1 - alpha) * R * problem.dt
    return temperature * (1 - alpha) / std**2 * jnp.eye(len(R))


def girsanov(nominal: Array, increments: Array, weight: Array) -> Array:
    """Returns sum_k nominal_k' W delta_k (N,).

    Args:
        nominal: (H, nu)
        increments: delta (H, nu, N)
        weight: W of `girsanov_weight` (nu, nu)
    """
    return jnp.tensordot(nominal @ weight, increments, axes=2)


def shifted(nominal: Array) -> Array:
    """Returns the nominal (H, nu) one step later, padded with no control: the warm start."""
    return jnp.concatenate([nominal[1:], jnp.zeros_like(nominal[:1])])


def rollouts(
    problem: Problem, mean: Array, controls: Array, disturbance: Array | None = None
) -> Array:
    """Returns the means mu_1..mu_H (H, nx, N) of sampled paths.

    Args:
        problem: the problem, for its dynamics
        mean: (nx,) where all paths start, or (nx, N)
        controls: (H, nu, N)
        disturbance: (H, nx, N) added to the mean at every step
    """
    move = vmap_last(
        lambda mu, u: euler_step(problem.system, mu, u, problem.dt), mapped=(True, True)
    )

    def advance(mu: Array, inputs: tuple[Array, Array | None]) -> tuple[Array, Array]:
        u, push = inputs
        mu = move(mu, u) if push is None else move(mu, u) + push
        return mu, mu

    start = _one_per_path(mean, controls.shape[-1])
    return jax.lax.scan(advance, start, (controls, disturbance))[1]


def interpolated(start: Array, end: Array, part: float) -> Array:
    """Returns the array at a part (0 to 1) of the straight line between two arrays."""
    return start if part == 0 else (1 - part) * start + part * end


def _one_per_path(mean: Array, n_samples: int) -> Array:
    """Returns means (nx, N) for one mean (nx,), or the means that are given."""
    return mean if mean.ndim > 1 else jnp.broadcast_to(mean[:, None], (len(mean), n_samples))


def accumulated_costs(
    problem: Problem,
    mean: Array,
    means: Array,
    covs: Array,
    charged: tuple[float, ...],
    running: Callable[[Array, Array], Array],
    terminal: Callable[[Array, Array], Array],
) -> Array:
    """Returns sum_k q dt + phi (N,) of paths along planned covariances.

    Between two states means and covariances are interpolated linearly.

    Args:
        problem: the problem, for its time step
        mean: (nx,) where all paths start, or (nx, N)
        means: (H, nx, N) means at t_1..t_H
        covs: (H+1, nx, nx) covariances at t_0..t_H
        charged: the parts of a step at which q is taken and averaged: (1,) takes it at t_{k+1},
            where the control has led to, (0,) at t_k as in Algorithm 1 as printed
        running: maps one mean (nx,) and covariance (nx, nx) to a cost per second ()
        terminal: maps the same to a cost ()
    """
    over_paths = jax.vmap(running, in_axes=(-1, None), out_axes=-1)

    def rates_at(part: float) -> Array:
        """Returns q (H, N) at one part of every step."""
        if part == 1:
            return jax.vmap(over_paths)(means, covs[1:])
        first = _one_per_path(mean, means.shape[-1])[None]
        before = jnp.concatenate([first, means[:-1]])
        return jax.vmap(over_paths)(
            interpolated(before, means, part), interpolated(covs[:-1], covs[1:], part)
        )

    rates = rates_at(charged[0])
    for part in charged[1:]:
        rates = rates + rates_at(part)
    if len(charged) > 1:
        rates = rates / len(charged)
    last = jax.vmap(terminal, in_axes=(-1, None), out_axes=-1)(means[-1], covs[-1])
    return jnp.full(len(rates), problem.dt) @ rates + last
