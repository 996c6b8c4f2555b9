"""A covariance for every sampled path: each carries the filter's own recursion along itself.

    S = sum_k q(mu_k, Sigma_k) dt + phi(mu_H, Sigma_H)

where Sigma_k is what the filter will have made of the belief along mu_0..mu_k, not along one
nominal for all (Assumption 1). A path to where the sensor is good is then charged for the smaller
covariance that it leads to, so that detours for information can be planned.
docs/beyond/belief_joint.md says what it optimises.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from ...belief.gaussian import RootBelief, covariance, covariance_root
from ...belief.kalman import filter_step
from ...belief.schedule import gain_schedule
from ...numerics.scalarized import vmap_scalarized
from ...problem import Problem
from ...structs import struct
from ..parts import PathCost
from .shared import GaussianPlan


@struct
class PerPathCovariance:
    """Plans a covariance along every sampled path; of a mixture, from its mean and covariance."""

    def plan(
        self, problem: Problem, path_cost: PathCost, belief: Any, controls: Array
    ) -> "PerPathPlan":
        """Returns what paths start from; `controls` (H, nu) are the nominal."""
        start = RootBelief(belief.mean, covariance_root(belief))
        return PerPathPlan(problem, path_cost, start, controls)


@dataclass(frozen=True)
class PerPathPlan:
    """Prices every path by the covariance that the filter would have along it."""

    problem: Problem
    path_cost: PathCost
    start: RootBelief
    controls: Array  # (H, nu): the nominal

    @property
    def cov(self) -> Array:
        """Returns the planned covariances (H+1, nx, nx) along the nominal."""
        return self.moments.cov

    @property
    def nominal_cost(self) -> Array:
        """Returns the state cost () of the nominal plan."""
        return self.costs(self.controls[:, :, None], None)[0][0]

    @property
    def moments(self) -> GaussianPlan:
        """Returns the plan with one covariance for all paths, the one along the nominal."""
        schedule = gain_schedule(self.problem, self.start, self.controls)
        return GaussianPlan(self.problem, self.path_cost, self.start.mean, schedule)

    def costs(self, controls: Array, means: Array | None) -> tuple[Array, Array]:
        """Returns state costs (N,) and means (H, nx, N) of paths with controls (H, nu, N)."""
        problem = self.problem
        path_cost = self.path_cost
        n_samples = controls.shape[-1]

        # Functions of one path, mapped over all of them.
        step = vmap_scalarized(
            lambda mean, root, u: filter_step(problem, mean, root, u)[:2], (True, True, True)
        )
        spread = vmap_scalarized(covariance, (True,))
        charge = vmap_scalarized(
            lambda mean, cov: path_cost.running(problem, mean, cov), (True, True)
        )
        charge_end = vmap_scalarized(
            lambda mean, root: path_cost.terminal(problem, mean, covariance(root)), (True, True)
        )
        Carry = tuple[Array, Array, Array]

        def advance(carry: Carry, u: Array) -> tuple[Carry, Array]:
            mean, root, total = carry
            # The barriers keep XLA from computing the filter anew for every term of the cost.
            after = jax.lax.optimization_barrier(step(mean, root, u))
            charged = after if path_cost.at_step_end else (mean, root)
            rate = charge(charged[0], jax.lax.optimization_barrier(spread(charged[1])))
            return (*after, total + rate * problem.dt), after[0]

        # Every path starts from the same belief.
        mean, root = (
            jnp.broadcast_to(part[..., None], (*part.shape, n_samples)) for part in self.start
        )
        (mean, root, total), path_means = jax.lax.scan(
            advance, (mean, root, jnp.zeros(n_samples)), controls
        )
        return total + charge_end(mean, root), path_means
