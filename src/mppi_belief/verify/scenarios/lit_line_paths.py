"""Psi and the control of the lit line from the package's own sampled paths."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from ...belief.cost import expected_terminal, risk_sensitive
from ...belief.gaussian import RootBelief
from ...planning import path_integral as pi
from ...planning.path_costs import RiskSensitive
from ...planning.schedules import PerPathCovariance
from ...problem import Problem
from ..compilation import quick_jit
from .lit_line import LIT_TEMPERATURE, LIT_THETA

LIT_PATHS = 1 << 16  # sampled paths


class SampledPlan(NamedTuple):
    """Holds what the package's paths give at one belief."""

    psi: float
    psi_error: float  # standard error
    control: float  # the first one
    control_error: float  # standard error
    shared: float  # V with one covariance for all paths, less V


def sample_plan(problem: Problem, mean: float, std: float, key: Array) -> SampledPlan:
    """Returns Psi and the first control from the package's own paths."""
    increments, costs, shared_costs = (
        np.asarray(part)
        for part in _sampled_paths(problem, jnp.array([mean]), jnp.array([[std]]), key)
    )
    w = np.exp(-costs / LIT_TEMPERATURE)
    psi = w.mean()
    control = (w @ increments) / w.sum()
    shared_psi = np.mean(np.exp(-shared_costs / LIT_TEMPERATURE))
    mean_square = np.mean((w * (increments - control)) ** 2)
    return SampledPlan(
        psi=psi,
        psi_error=w.std(ddof=1) / np.sqrt(len(w)),
        control=control,
        control_error=np.sqrt(mean_square / len(w)) / psi,
        shared=LIT_TEMPERATURE * np.log(psi / shared_psi),
    )


@quick_jit
def _sampled_paths(
    problem: Problem, mean: Array, root: Array, key: Array
) -> tuple[Array, Array, Array]:
    """Returns first increments and costs of paths, each (N,).

    The first costs are with a covariance for each path, the second with that of the uncontrolled
    path for all.
    """
    start = RootBelief(mean, root)
    no_controls = jnp.zeros((problem.steps, 1))
    plan = PerPathCovariance().plan(problem, RiskSensitive(LIT_THETA), start, no_controls)
    normals = pi.normals(key, (problem.steps, 1, LIT_PATHS), False)
    increments = pi.matched_increments(problem, normals, LIT_TEMPERATURE, None)
    costs, means = plan.costs(increments, None)
    shared_costs = pi.accumulated_costs(
        problem,
        mean,
        means,
        plan.cov,
        (1.0,),
        lambda mu, cov: risk_sensitive(problem, mu, cov, LIT_THETA),
        lambda mu, cov: expected_terminal(problem, mu, cov),
    )
    return increments[0, 0], costs, shared_costs
