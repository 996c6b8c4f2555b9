"""Trajectory optimisation by iterated LQ approximation (Todorov and Li 2005; Tassa et al. 2012).

    minimise  sum_{k<H} 1/2 u_k' R u_k dt + sum_{k<=H} w_k q(x_k) dt + phi(x_H)
    where     x_{k+1} is the Euler step of (1a) from x_k under u_k

w_k is 1 but for one end of the horizon, see `lq_problem.charge_weights`. Each iteration expands the
dynamics to first and the costs to second order about the nominal (state Hessians projected to PSD,
so that every backward pass is well posed), solves the LQ problem, and searches along its direction.
Additive process noise, and sensor noise even if it depends on the state, does not change this
solution (certainty equivalence).

Symbols: H steps of the horizon, nx states, nu controls.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ..belief.prior import prior
from ..discretise import euler_step
from ..numerics.linalg import quadratic_form
from ..problem import Problem
from .lq_problem import Improvement, StateCost, backward_pass, expand, time_varying_cost

HALVINGS = 12  # step lengths 1, 1/2, 1/4, ... that the line search tries
SUFFICIENT = 1e-4  # part of the predicted decrease that a step must reach (Armijo)


class Policy(NamedTuple):
    """Represents feedback about a trajectory: u_k = controls_k + gains_k (x - states_k)."""

    states: Array  # (H+1, nx)
    controls: Array  # (H, nu): feedforward
    gains: Array  # (H, nu, nx)


class ILQRSolution(NamedTuple):
    """Holds a policy, its cost and how many iterations it took."""

    policy: Policy
    cost: Array  # (): the objective along the policy
    iterations: Array  # (): how many were used
    converged: Array  # (): whether they sufficed


class ILQRInfo(NamedTuple):
    """Holds the diagnostics of one step of a planner without samples."""

    ess: Array  # (): not a number, since there is no effective sample size
    nominal_cost: Array  # (): cost of the plan
    iterations: Array  # ()
    converged: Array  # ()


class ILQRSettings(NamedTuple):
    """Says when to stop, and how much to regularise."""

    tolerance: Array | float  # relative decrease of the cost at which the plan has converged
    max_iterations: Array | int
    damping: Array | float  # added to Quu once a line search has failed
    damping_factor: Array | float  # growth of damping after a failure, its decay after a success
    damping_max: Array | float  # where the iteration gives up


def state_cost(
    problem: Problem, rate: Callable[[Array], Array], horizon: int, at_step_end: bool
) -> StateCost:
    """Returns (x, k) -> w_k q(x) dt, plus phi(x) at k = H, for a running cost `rate`."""
    return time_varying_cost(
        problem.dt, lambda x, k: rate(x), problem.cost.terminal, horizon, at_step_end
    )


def forward_rollout(
    problem: Problem,
    policy: Policy,
    start: Array,
    step_length: Array | float = 0.0,
    feedforward: Array | None = None,
) -> Policy:
    """Returns the policy about its own trajectory from `start`.

    Args:
        problem: the problem, for its dynamics
        policy: the policy to roll out
        start: (nx,)
        step_length: how much of `feedforward` is added to the controls
        feedforward: (H, nu) change of the controls; None for no change
    """
    if feedforward is None:
        feedforward = jnp.zeros_like(policy.controls)

    def advance(
        x: Array, inputs: tuple[Array, Array, Array, Array]
    ) -> tuple[Array, tuple[Array, Array]]:
        nominal, u, gain, change = inputs
        u = u + step_length * change + gain @ (x - nominal)
        return euler_step(problem.system, x, u, problem.dt), (x, u)

    last, (states, controls) = jax.lax.scan(
        advance, start, (policy.states[:-1], policy.controls, policy.gains, feedforward)
    )
    return Policy(jnp.concatenate([states, last[None]]), controls, policy.gains)


def total_cost(problem: Problem, cost: StateCost, policy: Policy) -> Array:
    """Returns the objective () of a policy's states and controls."""
    states = jax.vmap(cost)(policy.states, jnp.arange(len(policy.states)))
    controls = jax.vmap(lambda u: 0.5 * quadratic_form(problem.cost.R, u))(policy.controls)
    return jnp.sum(states) + jnp.sum(controls) * problem.dt


def lq_improvement(
    problem: Problem, cost: StateCost, policy: Policy, damping: Array | float = 0.0
) -> Improvement:
    """Returns the solution of the LQ problem expanded about a policy's trajectory."""
    R = problem.cost.R
    dt = problem.dt
    control_gradients = jax.vmap(lambda u: R @ u * dt)(policy.controls)
    lq = expand(problem, cost, policy.states, policy.controls)
    return backward_pass(lq, control_gradients, R * dt, damping)


class _SolverState(NamedTuple):
    """Holds what one iteration hands to the next."""

    policy: Policy
    cost: Array  # ()
    damping: Array  # ()
    iterations: Array  # (): done so far
    converged: Array  # ()


def solve(
    problem: Problem, cost: StateCost, guess: Policy, start: Array, settings: ILQRSettings
) -> ILQRSolution:
    """Iterates from a guess until the relative decrease of the cost is below the tolerance.

    Args:
        problem: the problem, for dynamics and control weight
        cost: of a state at a step
        guess: the first policy; its own feedback brings it to `start`
        start: (nx,)
        settings: when to stop, and how much to regularise
    """

    def unfinished(state: _SolverState) -> Array:
        return (
            (state.iterations < settings.max_iterations)
            & ~state.converged
            & (state.damping < settings.damping_max)
        )

    def improve_once(state: _SolverState) -> _SolverState:
        return _iterate(problem, cost, settings, state)

    first = forward_rollout(problem, guess, start)
    state = _SolverState(
        first,
        total_cost(problem, cost, first),
        jnp.zeros(()),
        jnp.zeros((), int),
        jnp.zeros((), bool),
    )
    state = jax.lax.while_loop(unfinished, improve_once, state)
    return ILQRSolution(state.policy, state.cost, state.iterations, state.converged)


def _iterate(
    problem: Problem, cost: StateCost, settings: ILQRSettings, state: _SolverState
) -> _SolverState:
    """Improves the policy once: a backward pass, and a line search along its direction."""
    policy, best, damping, iterations, _ = state

    # Backward pass.
    feedforward, gains, _, change = lq_improvement(problem, cost, policy, damping)
    finite = jnp.all(jnp.isfinite(gains))  # not where derivatives are so large that they overflow
    gains = jnp.where(finite, gains, policy.gains)
    closed_loop = policy._replace(gains=gains)

    # Line search: the longest step with sufficient decrease.
    lengths = 0.5 ** jnp.arange(HALVINGS, dtype=best.dtype)
    candidates = jax.vmap(
        lambda s: forward_rollout(problem, closed_loop, policy.states[0], s, feedforward)
    )(lengths)
    costs = jax.vmap(lambda candidate: total_cost(problem, cost, candidate))(candidates)
    predicted = lengths * change[0] + lengths**2 * change[1]
    sufficient = costs - best <= SUFFICIENT * predicted
    chosen = jnp.argmax(sufficient)
    improved = sufficient[chosen] & jnp.isfinite(costs[chosen])

    # The new policy, or the old one with the new feedback.
    policy = jax.tree.map(
        lambda new, old: jnp.where(improved, new[chosen], old), candidates, policy
    )
    policy = policy._replace(gains=gains)

    # Regularisation: less after a success, more after a failure, none below its least value.
    damping = jnp.where(
        improved,
        damping / settings.damping_factor,
        jnp.maximum(damping, settings.damping) * settings.damping_factor,
    )
    damping = jnp.where(damping < settings.damping, 0.0, damping)

    # Convergence: the decrease that was predicted is small.
    converged = jnp.abs(change[0] + change[1]) <= settings.tolerance * (1.0 + jnp.abs(best))
    best = jnp.where(improved, costs[chosen], best)
    return _SolverState(policy, best, damping, iterations + 1, converged)


def uncontrolled(problem: Problem, horizon: int) -> Policy:
    """Returns the policy without control and feedback, from the prior mean."""
    nx = len(problem.prior_mean)
    nu = problem.cost.R.shape[0]
    states = jnp.zeros((horizon + 1, nx))
    policy = Policy(states, jnp.zeros((horizon, nu)), jnp.zeros((horizon, nu, nx)))
    return forward_rollout(problem, policy, prior(problem).mean)


def warm_start(policy: Policy) -> Policy:
    """Returns the policy one step later; its last step is without control and feedback."""
    states = jnp.concatenate([policy.states[1:], policy.states[-1:]])
    controls = jnp.concatenate([policy.controls[1:], jnp.zeros_like(policy.controls[:1])])
    gains = jnp.concatenate([policy.gains[1:], jnp.zeros_like(policy.gains[:1])])
    return Policy(states, controls, gains)
