"""Remark 4: whether the expansion of the entropic risk that begins with q_RS decreases.

    rho = kappa_1 + theta/2 kappa_2 + theta^2/6 kappa_3 + ...

kappa_n are the cumulants of the running cost.

Where the third term exceeds the second, q_RS does not approximate the entropic risk.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...numerics.quadrature import gaussian_nodes
from ...numerics.square_root import psd_factor
from ...planning.path_costs import RiskSensitive
from ...problem import Controller, Problem
from ...results.certificate import Check
from ..bands import at_most
from .trial_path import TrialPath

LARGEST_RATIO = 1.0  # of the third-order term to the second-order one


def expansion_conditions(problem: Problem, path: TrialPath, controller: Controller) -> list[Check]:
    """Returns the condition of Remark 4, or no check if the path cost is not `RiskSensitive`."""
    path_cost = getattr(controller, "path_cost", None)
    if not isinstance(path_cost, RiskSensitive):
        return []
    theta = path_cost.theta
    of_total_cost = path_cost.variance_of == "total"
    mean, cov, *_ = path.schedule
    third_over_second = _cumulant_ratios(
        problem, mean, cov, float(of_total_cost), *gaussian_nodes(mean.shape[1])
    )
    ratios = float(theta) * np.abs(third_over_second)
    worst = int(np.argmax(ratios))
    what = "the cost" if of_total_cost else "the penalty"
    return [
        at_most(
            f"Remark 4, theta = {float(theta):g}, {what}: "
            f"third over second term of rho, largest at step {worst}",
            ratios[worst],
            LARGEST_RATIO,
            "the terms of the expansion must decrease",
        )
    ]


@jax.jit
def _cumulant_ratios(
    problem: Problem,
    means: Array,
    covs: Array,
    base_weight: Array,
    points: Array,
    weights: Array,
) -> Array:
    """Returns kappa_3 / (3 kappa_2) (P,) of `base_weight` times the base cost plus the penalty.

    Means are (P, nx), covariances (P, nx, nx).
    """

    def ratio(belief: tuple[Array, Array]) -> Array:
        mean, cov = belief
        factor, _ = psd_factor(cov)
        states = mean + points @ factor.T
        q = jax.vmap(lambda x: base_weight * problem.cost.base(x) + problem.penalty(x))(states)
        q = q - weights @ q
        second = weights @ q**2
        third = weights @ q**3
        return jnp.where(second > 0, third / (3 * jnp.where(second > 0, second, 1.0)), 0.0)

    return jax.lax.map(ratio, (means, covs))
