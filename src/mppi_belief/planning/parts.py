"""The three parts of a sampling planner, as Protocols: path cost, sampler and schedule.

    path cost   what a planned belief costs: q(mu, Sigma) and phi(mu, Sigma)   (3)(4), Remark 4
    sampler     where paths are drawn, and with which density                  (18), Girsanov
    schedule    how the covariance along a path is planned                     Assumption 1

A planner (`mppi_belief.controllers.MPPI`) puts one of each together. A new idea is one class in one
of the folders beside this module, with one yaml in conf/controller/path_cost, sampler or schedule.

Symbols: H steps of the horizon, N sampled paths, nx states, nu controls, m components of a mixture.
"""

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

from jax import Array

from ..belief.schedule import GainSchedule
from ..problem import Problem


@runtime_checkable
class PathCost(Protocol):
    """Says what a planned Gaussian belief costs."""

    @property
    def at_step_end(self) -> bool:
        """Says whether a step is charged for the belief it leads to, or for its start."""

    def running(self, problem: Problem, mean: Array, cov: Array) -> Array:
        """Returns the cost per second () of a belief with mean (nx,) and covariance (nx, nx)."""

    def terminal(self, problem: Problem, mean: Array, cov: Array) -> Array:
        """Returns the cost () of the belief at the end of the horizon."""


@runtime_checkable
class ChargesBetweenStates(PathCost, Protocol):
    """Adds to a path cost that a step may be charged between its two states, too.

    A step then costs the mean over m equally spaced points of the straight line between its planned
    beliefs, the last (or the first) of them being the state that is charged otherwise.
    """

    @property
    def points_per_step(self) -> int:
        """Returns m; a path cost without it charges one state per step."""


@runtime_checkable
class MixturePathCost(PathCost, Protocol):
    """Says what a planned mixture of Gaussians costs, too.

    A path cost without these two is given the mean and the covariance of the mixture.
    """

    def mixture_running(self, problem: Problem, weights: Array, means: Array, covs: Array) -> Array:
        """Returns the cost per second () of weights (m,), means (m, nx), covs (m, nx, nx)."""

    def mixture_terminal(
        self, problem: Problem, weights: Array, means: Array, covs: Array
    ) -> Array:
        """Returns the cost () of the mixture at the end of the horizon."""


def charged_parts(path_cost: PathCost) -> tuple[float, ...]:
    """Returns the parts of a step at which it is charged: (1,) for its end, (0,) for its start."""
    m = path_cost.points_per_step if isinstance(path_cost, ChargesBetweenStates) else 1
    first = 1 if path_cost.at_step_end else 0
    return tuple((first + j) / m for j in range(m))


class DrawnPaths(NamedTuple):
    """Holds paths as a sampler draws them."""

    increments: Array  # (H, nu, N): the controls less those of the nominal plan
    means: Array | None  # (H, nx, N): belief means along them, where the sampler knows them
    correction: Array  # (N,): what (19) adds to path costs for the density that was drawn from


Draw = Callable[[Array, int], DrawnPaths]  # random key, N -> N paths


class PlannedBelief(Protocol):
    """Holds what is known in advance of the belief along a plan, and prices paths with it."""

    @property
    def cov(self) -> Array:
        """Returns the planned covariances (H+1, nx, nx) along the nominal plan."""

    @property
    def nominal_cost(self) -> Array:
        """Returns the state cost () of the nominal plan itself."""

    @property
    def moments(self) -> "PlannedGaussian":
        """Returns the plan of one Gaussian with the belief's mean and covariance."""

    def costs(self, controls: Array, means: Array | None) -> tuple[Array, Array]:
        """Returns the state costs (N,) and the belief means (H, nx, N) of paths.

        Args:
            controls: (H, nu, N)
            means: (H, nx, N), where the sampler knows them already
        """


class PlannedGaussian(PlannedBelief, Protocol):
    """Holds one gain schedule along a plan."""

    @property
    def schedule(self) -> GainSchedule:
        """Returns means, covariances, gains and diffusions along the nominal plan."""


@runtime_checkable
class Schedule(Protocol):
    """Says how the covariance along a path is planned."""

    follows_controls: ClassVar[bool]  # whether the filter is run along the controls of every path

    def plan(
        self, problem: Problem, path_cost: PathCost, belief: Any, controls: Array
    ) -> PlannedBelief:
        """Returns what is known in advance of a belief along the nominal controls (H, nu)."""


@runtime_checkable
class Sampler(Protocol):
    """Says where paths are drawn and with which density."""

    disturbs_mean: ClassVar[bool]  # whether paths are of the mean itself and no control leads there

    def prepare(
        self,
        problem: Problem,
        path_cost: PathCost,
        planned: PlannedBelief,
        nominal: Array,
        temperature: Array | float,
    ) -> Draw:
        """Returns a function that draws paths about the nominal controls (H, nu)."""

    def warm_start(self, improved: Array) -> Array:
        """Returns the nominal (H, nu) of the next step from the improved plan (H, nu)."""


@runtime_checkable
class SampledPaths(Protocol):
    """Marks diagnostics that hold the sampled paths, which can then be recorded."""

    @property
    def means(self) -> Array:
        """Returns the belief means (H, nx, N) along the paths."""

    @property
    def weights(self) -> Array:
        """Returns the weights (N,) of the paths, which add up to one."""


@runtime_checkable
class ChecksFit(Protocol):
    """Marks a controller or a part of one that does not go with every problem."""

    def check_fit(self, problem: Problem) -> None:
        """Raises `ValueError`, which begins with the name of a field, where it does not fit."""


@runtime_checkable
class ExpandsCost(Protocol):
    """Marks a controller or a part of one that differentiates the cost."""

    @property
    def expands_cost(self) -> bool:
        """Says whether the cost is expanded to second order."""


class PlanInfo(NamedTuple):
    """Holds the diagnostics of one step of a sampling planner."""

    ess: Array  # (): effective sample size
    nominal_cost: Array  # (): state cost of the nominal plan that the step started from
    planned_cov: Array  # (H+1, nx, nx): planned covariances along it
    means: Array  # (H, nx, N): belief means of the sampled paths
    weights: Array  # (N,): their weights, adding up to one
