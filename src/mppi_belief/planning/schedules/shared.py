"""One covariance per step for all paths, planned along the nominal (Assumption 1).

    S = sum_k q(mu_k, Sigma_k) dt + phi(mu_H, Sigma_H),   Sigma_k along the nominal trajectory

Of a mixture of Gaussians (`filter=mixture`) every component moves from its own mean under the same
controls, with a schedule of its own; costs are those of the mixture, its weights held at their
present values over the horizon.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jax import Array

from ...belief.gaussian import MixtureBelief, RootBelief, mixture_covariance
from ...belief.schedule import GainSchedule, gain_schedule
from ...problem import Problem
from ...structs import choice, struct
from ..parts import MixturePathCost, PathCost, charged_parts
from ..path_integral import accumulated_costs, rollouts


@struct
class SharedCovariance:
    """Plans one covariance per step, shared by all paths.

    Fields:
        method: "filter" runs the filter's own recursion, "riccati" solves (11); see `gain_schedule`
        components: whether a mixture is planned by component, or else by its mean and covariance
    """

    method: str = choice("filter", "riccati", default="filter")
    components: bool = choice(True, False, default=True)

    follows_controls: ClassVar[bool] = False

    def plan(
        self, problem: Problem, path_cost: PathCost, belief: Any, controls: Array
    ) -> "GaussianPlan | MixturePlan":
        """Returns the schedule along the nominal controls (H, nu), or one per component."""
        gaussian = not (self.components and isinstance(belief, MixtureBelief))
        if gaussian or not isinstance(path_cost, MixturePathCost):
            schedule = gain_schedule(problem, belief, controls, self.method)
            return GaussianPlan(problem, path_cost, belief.mean, schedule)
        schedules = jax.vmap(
            lambda mean, root: gain_schedule(problem, RootBelief(mean, root), controls, self.method)
        )(belief.means, belief.roots)
        return MixturePlan(problem, path_cost, belief, schedules, controls, self.method)


@dataclass(frozen=True)
class GaussianPlan:
    """Prices paths of one Gaussian by its gain schedule."""

    problem: Problem
    path_cost: PathCost
    mean: Array  # (nx,): where paths start
    schedule: GainSchedule

    @property
    def cov(self) -> Array:
        """Returns the planned covariances (H+1, nx, nx)."""
        return self.schedule.cov

    @property
    def nominal_cost(self) -> Array:
        """Returns the state cost () of the nominal plan."""
        return self.state_costs(self.schedule.mean[1:, :, None])[0]

    @property
    def moments(self) -> "GaussianPlan":
        """Returns the plan itself."""
        return self

    def costs(self, controls: Array, means: Array | None) -> tuple[Array, Array]:
        """Returns state costs (N,) and means (H, nx, N) of paths with controls (H, nu, N)."""
        if means is None:
            means = rollouts(self.problem, self.mean, controls)
        return self.state_costs(means), means

    def state_costs(self, means: Array) -> Array:
        """Returns the state costs (N,) of means (H, nx, N)."""
        return accumulated_costs(
            self.problem,
            self.mean,
            means,
            self.schedule.cov,
            charged_parts(self.path_cost),
            lambda mu, cov: self.path_cost.running(self.problem, mu, cov),
            lambda mu, cov: self.path_cost.terminal(self.problem, mu, cov),
        )


@dataclass(frozen=True)
class MixturePlan:
    """Prices paths of a mixture by the gain schedules of its components."""

    problem: Problem
    path_cost: MixturePathCost
    belief: MixtureBelief
    schedules: GainSchedule  # each array with an axis (m,) for the components before all others
    controls: Array  # (H, nu): the nominal
    method: str

    @property
    def means(self) -> Array:
        """Returns the means (H+1, m, nx) of the components along the nominal."""
        return jnp.swapaxes(self.schedules.mean, 0, 1)

    @property
    def covs(self) -> Array:
        """Returns the covariances (H+1, m, nx, nx) of the components along the nominal."""
        return jnp.swapaxes(self.schedules.cov, 0, 1)

    @property
    def cov(self) -> Array:
        """Returns the planned covariances (H+1, nx, nx) of the mixture."""
        of_mixture = jax.vmap(mixture_covariance, in_axes=(None, 0, 0))
        return of_mixture(self.belief.weights, self.means, self.covs)

    @property
    def nominal_cost(self) -> Array:
        """Returns the state cost () of the nominal plan."""
        return self.state_costs(self.means[1:, :, :, None])[0]

    @property
    def moments(self) -> GaussianPlan:
        """Returns the plan of one Gaussian with the mixture's mean and covariance."""
        schedule = gain_schedule(self.problem, self.belief, self.controls, self.method)
        return GaussianPlan(self.problem, self.path_cost, self.belief.mean, schedule)

    def costs(self, controls: Array, means: Array | None) -> tuple[Array, Array]:
        """Returns state costs (N,) and mixture means (H, nx, N) for controls (H, nu, N)."""
        from_each = jax.vmap(lambda mean: rollouts(self.problem, mean, controls), out_axes=1)
        of_each = from_each(self.belief.means)
        mixture_means = jnp.einsum("i,hi...->h...", self.belief.weights, of_each)
        return self.state_costs(of_each), mixture_means

    def state_costs(self, means: Array) -> Array:
        """Returns the state costs (N,) of the components' means (H, m, nx, N)."""
        weights = self.belief.weights
        starts = jnp.broadcast_to(self.belief.means[:, :, None], means.shape[1:])
        return accumulated_costs(
            self.problem,
            starts,
            means,
            self.covs,
            charged_parts(self.path_cost),
            lambda mus, covs: self.path_cost.mixture_running(self.problem, weights, mus, covs),
            lambda mus, covs: self.path_cost.mixture_terminal(self.problem, weights, mus, covs),
        )
