"""A covariance for every sampled path: each carries the filter's own recursion along itself.

    S = sum_k q(mu_k, Sigma_k) dt + phi(mu_H, Sigma_H)

where Sigma_k is what the filter will have made of the belief along mu_0..mu_k, not along one
nominal for all (Assumption 1). A path to where the sensor is good is then charged for the smaller
covariance that it leads to, so that detours for information can be planned.
docs/beyond/belief_joint.md says what it optimises.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jax import Array

from ...belief.gaussian import RootBelief, covariance, covariance_root
from ...belief.kalman import filter_step
from ...belief.schedule import gain_schedule
from ...numerics.scalarized import vmap_scalarized
from ...problem import Problem
from ...structs import struct
from ..parts import PathCost, charged_parts
from ..path_integral import interpolated
from .shared import GaussianPlan


@struct
class PerPathCovariance:
    """Plans a covariance along every sampled path; of a mixture, from its mean and covariance."""

    follows_controls: ClassVar[bool] = True

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
        charged = charged_parts(path_cost)
        Carry = tuple[Array, Array, Array]

        def rate_of_step(before: tuple[Array, Array], after: tuple[Array, Array]) -> Array:
            """Returns q (N,) of a step, averaged over the parts of it that are charged."""
            rates = []
            for part in charged:
                if part in (0, 1):
                    mean, root = after if part else before
                    rates.append(charge(mean, jax.lax.optimization_barrier(spread(root))))
                    continue
                cov = interpolated(spread(before[1]), spread(after[1]), part)
                mean = interpolated(before[0], after[0], part)
                rates.append(charge(mean, jax.lax.optimization_barrier(cov)))
            return sum(rates[1:], rates[0]) / len(rates) if len(rates) > 1 else rates[0]

        def advance(carry: Carry, u: Array) -> tuple[Carry, Array]:
            mean, root, total = carry
            # The barriers keep XLA from computing the filter anew for every term of the cost.
            after = jax.lax.optimization_barrier(step(mean, root, u))
            rate = rate_of_step((mean, root), after)
            return (*after, total + rate * problem.dt), after[0]

        # Every path starts from the same belief.
        mean, root = (
            jnp.broadcast_to(part[..., None], (*part.shape, n_samples)) for part in self.start
        )
        (mean, root, total), path_means = jax.lax.scan(
            advance, (mean, root, jnp.zeros(n_samples)), controls
        )
        return total + charge_end(mean, root), path_means
