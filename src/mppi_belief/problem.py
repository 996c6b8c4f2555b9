"""The partially observed control problem (Sec. II): what is controlled, seen and paid for.

    dx = f(x) dt + G(x) u dt + H dw                                                  (1a)
    dy = c(x) dt + sigma_o(x) dnu                                                    (1b)
    J  = E[ phi(x_T) + int_0^T ( q(x_s) + 1/2 u_s' R u_s ) ds ]                      (2)

Symbols: nx states, nu controls, ny measurements, nw noise channels. All functions take one state,
without batch dimensions; batches are made by `jax.vmap`.

    here            paper                here             paper
    f, G, c         f, G, c              mean, cov        mu, Sigma
    H               H (noise channel)    horizon          H (Algorithm 1)
    sigma_o         sigma_o              R                R (control weight)
    base + penalty  q-bar                temperature      lambda
    terminal        phi-bar              dt               Delta t
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, runtime_checkable

from jax import Array

from .structs import array, number, size, struct


class Belief(NamedTuple):
    """A Gaussian belief N(mean, cov): mean (nx,), cov (nx, nx)."""

    mean: Array
    cov: Array


@runtime_checkable
class System(Protocol):
    """Control-affine dynamics (1a) and measurement (1b).

    Optional abilities: `WrappedMeasurements` and `SteerableSensor`.
    """

    @property
    def noise_convention(self) -> str:
        """What sigma_o means: "sample" or "intensity", see `mppi_belief.discretise`."""

    @property
    def H(self) -> Array:
        """Process noise channel (nx, nw)."""

    def f(self, x: Array) -> Array:
        """Uncontrolled drift: (nx,) -> (nx,)."""

    def G(self, x: Array) -> Array:
        """Control channel: (nx,) -> (nx, nu)."""

    def c(self, x: Array) -> Array:
        """Noise-free measurement: (nx,) -> (ny,)."""

    def sigma_o(self, x: Array) -> Array:
        """Measurement noise: (nx,) -> (ny, ny), invertible."""

    def position(self, x: Array) -> Array:
        """The components in which distances are measured: (nx,) -> (d,)."""

    def clearance(self, x: Array) -> Array:
        """Distance from x to the nearest obstacle surface, negative inside; inf without obstacles."""


@runtime_checkable
class WrappedMeasurements(Protocol):
    """Optional ability of a system whose measurements wrap, as angles do."""

    def difference(self, y: Array, predicted: Array) -> Array:
        """How far y is from predicted, (ny,) and (ny,) -> (ny,): zero where both mean the same.

        Systems without this method compare measurements by y - predicted.
        """


@runtime_checkable
class SteerableSensor(Protocol):
    """Optional ability of a system whose sensor follows the belief."""

    def aimed(self, mean: Array, root: Array, dt: Array | float, sampled: bool) -> System:
        """The system with the sensor chosen for a belief N(mean (nx,), root root' (nx, nx)).

        The choice may depend on nothing else, since filter, plant and planner each make it. With
        `sampled` the belief is the predicted one, before a measurement every dt; otherwise it is
        that of (8) at t.
        """


@runtime_checkable
class Cost(Protocol):
    """State cost q = base + penalty, terminal cost and control weight of (2)."""

    @property
    def R(self) -> Array:
        """Control weight (nu, nu), positive definite."""

    @property
    def goal(self) -> Array:
        """Where the terminal cost is least: (nx,)."""

    def base(self, x: Array) -> Array:
        """Running cost counted in results: (nx,) -> ()."""

    def penalty(self, x: Array) -> Array:
        """Running cost that only steers the planner (obstacles): (nx,) -> ()."""

    def terminal(self, x: Array) -> Array:
        """Terminal cost: (nx,) -> ()."""


class CostMoments(NamedTuple):
    """Moments of base and penalty under a Gaussian belief; every field ()."""

    base: Array
    penalty: Array
    base_var: Array
    penalty_var: Array
    covariance: Array


@runtime_checkable
class ClosedFormCost(Cost, Protocol):
    """A cost that knows its Gaussian moments; others are integrated by `mppi_belief.numerics.quadrature`."""

    def running_moments(self, mean: Array, cov: Array) -> CostMoments:
        """Moments under N(mean, cov)."""

    def terminal_mean(self, mean: Array, cov: Array) -> Array:
        """Expected terminal cost under N(mean, cov): ()."""


class Filter(Protocol):
    """Turns controls and measurements into a belief."""

    def init(self, problem: Problem, key: Array) -> Any:
        """The belief before the first control."""

    def update(self, problem: Problem, belief: Any, u: Array, y: Array, key: Array) -> Any:
        """The belief after control u (nu,) and the measurement y (ny,) that followed it."""


class Correction(NamedTuple):
    """What a Gaussian filter knows after a measurement."""

    posterior: Any  # the belief after the measurement, with `mean` (nx,) and `cov` (nx, nx)
    innovation: Array  # (ny,), the measurement less its forecast
    innovation_cov: Array  # S (ny, ny), the covariance that the filter gives the innovation


@runtime_checkable
class GaussianFilter(Filter, Protocol):
    """A filter whose update is a prediction and a correction, and which knows its innovations."""

    def predict(self, problem: Problem, belief: Any, u: Array) -> Any:
        """The belief one step after control u (nu,), before the measurement."""

    def correct(self, problem: Problem, belief: Any, y: Array) -> Correction:
        """The predicted belief corrected by the measurement y (ny,)."""


class Controller(Protocol):
    """Turns a belief into a control."""

    def init(self, problem: Problem) -> Any:
        """The plan carried between steps (warm start)."""

    def act(self, problem: Problem, belief: Any, plan: Any, key: Array) -> tuple[Array, Any, Any]:
        """-> control (nu,), the next plan, diagnostics with at least `ess` ()."""


@struct
class Problem:
    """Problem 1 with its prior N(prior_mean, diag(prior_std^2)) and its time grid t_k = k dt, k = 0..steps.

    With `prior_modes` (m, nx) the prior is the mixture of m Gaussians N(prior_mean + mode, diag(prior_std^2)), all
    as likely unless `prior_weights` (m,) says otherwise (they need not add up to one).
    """

    system: System
    cost: Cost
    prior_mean: Array = array(ndim=1)
    prior_std: Array = array(ndim=1, ge=0)
    dt: float = number(gt=0)
    steps: int = size()
    prior_modes: Array | None = array(default=None, ndim=2, optional=True)
    prior_weights: Array | None = array(default=None, ndim=1, gt=0, optional=True)
