"""The partially observed control problem (Sec. II): what is controlled, measured and charged.

    dx = f(x) dt + G(x) u dt + H dw                                                  (1a)
    dy = c(x) dt + sigma_o(x) dnu                                                    (1b)
    J  = E[ phi(x_T) + int_0^T ( q(x_s) + 1/2 u_s' R u_s ) ds ]                      (2)

Symbols: nx states, nu controls, ny measurements, nw noise channels, d components of the position.
All functions take one state, without batch dimensions; batches are made by `jax.vmap`.

    here            paper                here             paper
    f, G, c         f, G, c              mean, cov        mu, Sigma
    H               H (noise channel)    horizon          H (Algorithm 1)
    sigma_o         sigma_o              R                R (control weight)
    base + penalty  q-bar                temperature      lambda
    terminal        phi-bar              dt               Delta t

The system says how the state moves and is measured, the cost what is charged. The obstacles, which
components of the state are the position, and what sigma_o means are given once, to the problem.
"""

from __future__ import annotations

import inspect
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jax import Array

from .obstacles import ObstacleShape, Surroundings
from .obstacles.segments import path_clearance
from .structs import ArrayField, OptionalArrayField, array, choice, indices, number, size, struct


class Belief(NamedTuple):
    """Holds a Gaussian belief N(mean, cov)."""

    mean: Array  # (nx,)
    cov: Array  # (nx, nx)


@runtime_checkable
class System(Protocol):
    """Represents control-affine dynamics (1a) and measurement (1b).

    Optional abilities: `WrappedMeasurements`, `SteerableSensor` and `LabelledSystem`.
    """

    @property
    def H(self) -> Array:
        """Returns the process noise channel (nx, nw)."""

    def f(self, x: Array) -> Array:
        """Returns the uncontrolled drift: (nx,) -> (nx,)."""

    def G(self, x: Array) -> Array:
        """Returns the control channel: (nx,) -> (nx, nu)."""

    def c(self, x: Array) -> Array:
        """Returns the noise-free measurement: (nx,) -> (ny,)."""

    def sigma_o(self, x: Array) -> Array:
        """Returns the measurement noise, invertible: (nx,) -> (ny, ny)."""


@runtime_checkable
class WrappedMeasurements(Protocol):
    """Adds to a system that its measurements wrap, as angles do."""

    def difference(self, y: Array, predicted: Array) -> Array:
        """Returns y less predicted, (ny,) and (ny,) -> (ny,): zero where both mean the same.

        Systems without this method compare measurements by y - predicted.
        """


@runtime_checkable
class SteerableSensor(Protocol):
    """Adds to a system that its sensor follows the belief."""

    def aimed(self, problem: Problem, mean: Array, root: Array, sampled: bool) -> System:
        """Returns the system with the sensor for a belief N(mean (nx,), root root' (nx, nx)).

        The choice may depend on nothing else but the problem, since filter, plant and planner each
        make it. With `sampled` the belief is the predicted one, before a measurement every dt;
        otherwise it is that of (8) at t.
        """


@runtime_checkable
class LabelledSystem(Protocol):
    """Adds to a system the texts of its pictures. Either may be absent.

    Without labels the axes of a picture are named x and y; without units the shading by sigma_o has
    none, and is the root mean square over all measurements.
    """

    @property
    def state_labels(self) -> tuple[str, ...]:
        """Returns a label (nx,) per component of the state with its unit, such as "east (m)"."""

    @property
    def measurement_units(self) -> tuple[str, ...]:
        """Returns the unit (ny,) of each measurement.

        Where they differ, pictures show sigma_o of the measurements in the unit of the first.
        """


@runtime_checkable
class Cost(Protocol):
    """Represents the state cost q = base + penalty, terminal cost and control weight of (2)."""

    @property
    def R(self) -> Array:
        """Returns the control weight (nu, nu), positive definite."""

    @property
    def goal(self) -> Array:
        """Returns the state (nx,) with the least terminal cost."""

    def base(self, x: Array) -> Array:
        """Returns the running cost that results report: (nx,) -> ()."""

    def penalty(self, x: Array, surroundings: Surroundings) -> Array:
        """Returns the running cost that only steers the planner, as of obstacles: (nx,) -> ()."""

    def terminal(self, x: Array) -> Array:
        """Returns the terminal cost: (nx,) -> ()."""


class CostMoments(NamedTuple):
    """Holds the moments of base and penalty under a belief; every field is ()."""

    base: Array  # expectation of base
    penalty: Array  # expectation of penalty
    base_var: Array  # variance of base
    penalty_var: Array  # variance of penalty
    covariance: Array  # covariance of base and penalty


@runtime_checkable
class ClosedFormCost(Cost, Protocol):
    """Adds to a cost its Gaussian moments; those of other costs are integrated by quadrature."""

    def running_moments(self, mean: Array, cov: Array, surroundings: Surroundings) -> CostMoments:
        """Returns the moments under N(mean, cov), mean (nx,) and cov (nx, nx)."""

    def terminal_mean(self, mean: Array, cov: Array) -> Array:
        """Returns the expected terminal cost () under N(mean, cov)."""


class Filter(Protocol):
    """Turns controls and measurements into a belief."""

    def init(self, problem: Problem, key: Array) -> Any:
        """Returns the belief before the first control."""

    def update(self, problem: Problem, belief: Any, u: Array, y: Array, key: Array) -> Any:
        """Returns the belief after control u (nu,) and the measurement y (ny,) that followed."""


class Correction(NamedTuple):
    """Holds what a Gaussian filter knows after a measurement."""

    posterior: Any  # the belief after the measurement, with `mean` (nx,) and `cov` (nx, nx)
    innovation: Array  # (ny,), the measurement less its forecast
    innovation_cov: Array  # S (ny, ny), the covariance that the filter gives the innovation


@runtime_checkable
class GaussianFilter(Filter, Protocol):
    """Adds to a filter that its update is a prediction and a correction, with innovations."""

    def predict(self, problem: Problem, belief: Any, u: Array) -> Any:
        """Returns the belief one step after control u (nu,), before the measurement."""

    def correct(self, problem: Problem, belief: Any, y: Array) -> Correction:
        """Returns the predicted belief corrected by the measurement y (ny,)."""


class Controller(Protocol):
    """Turns a belief into a control."""

    def init(self, problem: Problem) -> Any:
        """Returns the plan that is carried between steps (warm start)."""

    def act(self, problem: Problem, belief: Any, plan: Any, key: Array) -> tuple[Array, Any, Any]:
        """Returns a control (nu,), the next plan, and diagnostics with at least `ess` ()."""


@runtime_checkable
class SeesState(Controller, Protocol):
    """Adds to a controller that it plans from the true state instead of a belief."""

    @property
    def sees_state(self) -> bool:
        """Says whether `act` is given the true state, as a belief without uncertainty."""


@runtime_checkable
class WeighsPaths(Controller, Protocol):
    """Adds to a controller that it weighs sampled paths at a temperature."""

    @property
    def temperature(self) -> Any:
        """Returns lambda (), in the unit of the cost."""


@struct
class Problem:
    """Holds Problem 1 with its prior N(prior_mean, diag(prior_std^2)) and time grid t_k = k dt.

    With `prior_modes` the prior is a mixture of Gaussians N(prior_mean + mode, diag(prior_std^2)).

    Raises:
        ValueError: for a system that has a position, a clearance or a noise convention of its own
    """

    system: System
    cost: Cost
    prior_mean: ArrayField = array(ndim=1)  # (nx,)
    prior_std: ArrayField = array(ndim=1, ge=0)  # (nx,)
    dt: float = number(gt=0)  # s
    steps: int = size()  # k = 0..steps
    obstacles: ObstacleShape | None = None  # None: there are none
    position: tuple[int, ...] | None = indices(default=None, optional=True)  # components; None: all
    noise_convention: str = choice("sample", "intensity", default="sample")  # see `discretise`
    prior_modes: OptionalArrayField = array(default=None, ndim=2, optional=True)  # (m, nx)
    prior_weights: OptionalArrayField = array(
        default=None, ndim=1, gt=0, optional=True
    )  # (m,), any sum
    collision_resolution: float = number(default=0.01, gt=0)  # m; see `path_clearance`
    # What the prior's spread is drawn for: the true start, the filter's mean about it, or nothing.
    initial_draw: str = choice("state", "mean", "none", default="state")  # see `belief.prior`

    def __post_init__(self) -> None:
        """Refuses a system that has what is given to the problem."""
        owned = [name for name in _GIVEN_TO_THE_PROBLEM if _has(self.system, name)]
        if owned:
            given = ", ".join(_GIVEN_TO_THE_PROBLEM[name] for name in owned)
            kind = type(self.system).__name__
            raise ValueError(
                f"system: {kind} has {', '.join(owned)}; these are the problem's, give it {given}"
            )

    @property
    def surroundings(self) -> Surroundings:
        """Returns the obstacles and the position, as a cost asks for them."""
        return Surroundings(self.obstacles, self.position)

    def position_of(self, x: Array) -> Array:
        """Returns the position of a state: (nx,) -> (d,)."""
        return self.surroundings.position(x)

    def clearance(self, x: Array) -> Array:
        """Returns the distance from a state to the nearest obstacle, inf without: (nx,) -> ()."""
        return self.surroundings.clearance(x)

    def path_clearance(self, states: Array) -> Array:
        """Returns the least distance to an obstacle (T,) on every step between states (T+1, nx).

        Positions move in straight lines between the states. With discs the distance is exact. For
        other obstacles it is taken at points that are at most `collision_resolution` apart, so none
        is missed that a step is inside for at least that length. It is inf without obstacles.
        """
        if self.obstacles is None:
            return jnp.full(len(states) - 1, jnp.inf)
        positions = jax.vmap(self.position_of)(states)
        return path_clearance(self.obstacles, positions, self.collision_resolution)

    def penalty(self, x: Array) -> Array:
        """Returns the running cost that only steers the planner: (nx,) -> ()."""
        return self.cost.penalty(x, self.surroundings)


_GIVEN_TO_THE_PROBLEM = {
    "position": "position (components of the state, such as [0, 1])",
    "clearance": "obstacles (with clearance(position))",
    "noise_convention": "noise_convention (sample or intensity)",
}


def _has(system: Any, name: str) -> bool:
    """Says whether a system has a method of this name, or a noise convention in any form."""
    member = inspect.getattr_static(system, name, None)
    return inspect.isfunction(member) or (name == "noise_convention" and member is not None)
