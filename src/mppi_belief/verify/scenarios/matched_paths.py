"""Sampled paths (18) of a matched problem's mean, and Algorithm 1 as printed on it."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...belief.cost import expected_terminal
from ...controllers import MPPI
from ...planning import path_integral as pi
from ...planning.path_costs import RiskSensitive
from ...planning.samplers import InnovationSampler
from ...planning.schedules import SharedCovariance
from ...problem import Belief, Problem
from .matched_scalar import MatchedProblem, SteadySchedule, total_risk

POOL = 2**17  # paths sampled at once


def sampled_costs(
    problem: Problem, theta: Array | float, mean: Array, schedule: SteadySchedule, eps: Array
) -> tuple[Array, Array]:
    """Returns path costs (N,) and L eps (H, nx, N): lines 4 to 11 of Algorithm 1.

    `eps` (H, nx, N) holds Brownian increments, `mean` (nx,) is the start of all paths.
    """
    H, _, N = eps.shape
    disturbance = jnp.einsum("hij,hjn->hin", schedule.factors[:H], eps)
    controls = jnp.zeros((H, problem.cost.R.shape[0], N))
    means = pi.rollouts(problem, mean, controls, disturbance)
    costs = pi.accumulated_costs(
        problem,
        mean,
        means,
        schedule.cov[: H + 1],
        (0.0,),
        lambda mu, cov: total_risk(problem, theta, mu, cov),
        lambda mu, cov: expected_terminal(problem, mu, cov),
    )
    return costs, disturbance


@partial(jax.jit, static_argnames=("steps", "n_samples"))
def _pool_of_paths(
    matched: MatchedProblem,
    mean: Array,
    schedule: SteadySchedule,
    key: Array,
    steps: int,
    n_samples: int,
) -> tuple[Array, Array]:
    eps = jnp.sqrt(matched.problem.dt) * pi.normals(key, (steps, 1, n_samples), False)
    costs, disturbance = sampled_costs(matched.problem, matched.theta, mean, schedule, eps)
    G = matched.problem.system.G(mean)
    R = matched.problem.cost.R
    return costs, (pi.control_map(G, R) @ disturbance[0] / matched.problem.dt)[0]


def pooled_costs(
    matched: MatchedProblem, schedule: SteadySchedule, mean: float, key: Array, paths: int
) -> tuple[np.ndarray, np.ndarray]:
    """Returns costs S (paths,) of independent paths of (18) from one mean.

    The second array (paths,) holds their first control increments.
    """
    pools = [
        _pool_of_paths(matched, np.array([mean]), schedule, pool_key, matched.problem.steps, POOL)
        for pool_key in jax.random.split(key, -(-paths // POOL))
    ]
    costs, increments = (
        np.concatenate([np.asarray(pool[part]) for pool in pools])[:paths] for part in (0, 1)
    )
    return costs, increments


def printed_algorithm(samples: int, problem: Problem, temperature: float, **options: Any) -> MPPI:
    """Returns Algorithm 1 as printed, with a horizon that covers the whole problem.

    `options` are those of `RiskSensitive`.
    """
    path_cost = RiskSensitive(at_step_end=False, **options)
    schedule = SharedCovariance(method="riccati")
    return MPPI(samples, problem.steps, temperature, path_cost, InnovationSampler(), schedule)


def first_controls(planner: MPPI, problem: Problem, means: Array, cov: Array, keys: Array) -> Array:
    """Returns u_0 (keys, means, nu) of the planner at means (means, nx) and Sigma (nx, nx).

    Every call starts from the planner's initial plan.
    """
    plan = planner.init(problem)

    def control(mean: Array, key: Array) -> Array:
        return planner.act(problem, Belief(mean, cov), plan, key)[0]

    return jax.lax.map(lambda key: jax.vmap(control, in_axes=(0, None))(means, key), keys)
