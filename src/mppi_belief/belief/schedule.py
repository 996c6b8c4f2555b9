"""Gain schedule (Assumption 1): the covariance, gain and diffusion along a nominal trajectory.

They do not depend on the measurements to come and are therefore known in advance.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ..discretise import euler_step, measurement_intensity
from ..numerics.square_root import psd_factor
from ..problem import Belief, Problem
from .gaussian import MixtureBelief, RootBelief, covariance, covariance_root
from .kalman import aim_sensor, filter_step
from .riccati import kalman_bucy_gain, riccati_root


class GainSchedule(NamedTuple):
    """Holds what is known of the belief in advance along a nominal trajectory of T steps."""

    mean: Array  # (T+1, nx), at t_0..t_T
    cov: Array  # Sigma (T+1, nx, nx), at t_0..t_T
    gain: Array  # K (T, nx, ny), of the steps between them
    diffusion: Array  # D (T, nx, nx), of the steps between them


def gain_schedule(
    problem: Problem,
    belief: Belief | RootBelief | MixtureBelief,
    controls: Array,
    method: str = "filter",
    means: Array | None = None,
) -> GainSchedule:
    """Returns the schedule along the mean that `controls` (T, nu) lead to from `belief`.

    Given `means` (T, nx) of t_1..t_T take the place of that mean. Method "filter" runs the discrete
    recursion that the filter itself runs (D = K S K' / dt); "riccati" solves (11) with coefficients
    frozen over each step (K and D of the continuous theory, at t_k).
    """
    step = {"filter": filter_step, "riccati": _riccati_schedule_step}[method]

    def advance(
        moments: tuple[Array, Array], inputs: tuple[Array, Array | None]
    ) -> tuple[tuple[Array, Array], tuple]:
        u, given_mean = inputs
        mean, root, gain, diffusion = step(problem, *moments, u)
        mean = mean if given_mean is None else given_mean
        return (mean, root), (mean, covariance(root), gain, diffusion)

    start = (belief.mean, covariance_root(belief))
    _, (mean, cov, gain, diffusion) = jax.lax.scan(advance, start, (controls, means))
    mean = jnp.concatenate([belief.mean[None], mean])
    cov = jnp.concatenate([belief.cov[None], cov])
    return GainSchedule(mean, cov, gain, diffusion)


def _riccati_schedule_step(
    problem: Problem, mean: Array, root: Array, u: Array
) -> tuple[Array, Array, Array, Array]:
    """Returns the next mean (nx,) and root (nx, nx), and K and D at t_k, in continuous time."""
    problem = aim_sensor(problem, mean, root, sampled=False)
    system = problem.system
    dt = problem.dt
    A = jax.jacfwd(lambda x: system.f(x) + system.G(x) @ u)(mean)
    C = jax.jacfwd(system.c)(mean)
    Q = system.H @ system.H.T
    R_o = measurement_intensity(problem, mean)
    K, D = kalman_bucy_gain(covariance(root), C, R_o)
    return euler_step(system, mean, u, dt), riccati_root(root, A, Q, C, R_o, dt), K, D


def diffusion_factors(schedule: GainSchedule) -> tuple[Array, Array]:
    """Returns L_k (T, nx, nx) with L_k L_k' = D_k, zero beyond the rank r_k, and r_k (T,)."""
    return jax.vmap(psd_factor)(schedule.diffusion)
