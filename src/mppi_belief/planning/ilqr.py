"""Trajectory optimisation by iterated LQ approximation (Todorov and Li 2005; Tassa et al. 2012).

    minimise  sum_{k<H} 1/2 u_k' R u_k dt + sum_{k<=H} w_k q(x_k) dt + phi(x_H),  x_{k+1} = Euler step of (1a)

w_k is 1 but for one end of the horizon, see `charge_weights`. Each iteration expands the dynamics to
first and the costs to second order about the nominal (state Hessians projected to PSD, so that every
backward pass is well posed), solves the LQ problem, and searches along its direction. Additive
noise, also one whose sensor noise depends on the state, leaves this solution as it is (certainty
equivalence).

Symbols: H steps of the horizon, T steps of an expansion, nx states, nu controls.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ..belief.prior import prior
from ..discretise import euler_step
from ..numerics.linalg import quadratic_form, spd_inverse, symmetrise
from ..problem import Problem

StateCost = Callable[[Array, Array], Array]  # state (nx,), step () -> cost ()

HALVINGS = 12  # step lengths 1, 1/2, 1/4, ... that the line search tries
SUFFICIENT = 1e-4  # part of the predicted decrease that a step must reach (Armijo)


class Policy(NamedTuple):
    """Feedback about a trajectory: u_k = controls_k + gains_k (x - states_k)."""

    states: Array  # (H+1, nx)
    controls: Array  # (H, nu): feedforward
    gains: Array  # (H, nu, nx)


class ILQRSolution(NamedTuple):
    """A policy and how it was found."""

    policy: Policy
    cost: Array  # (): the objective along the policy
    iterations: Array  # (): how many were used
    converged: Array  # (): whether they sufficed


class ILQRInfo(NamedTuple):
    """Diagnostics of one step of a planner without samples."""

    ess: Array  # (): not a number, since there is no effective sample size
    nominal_cost: Array  # (): cost of the plan
    iterations: Array  # ()
    converged: Array  # ()


class ILQRSettings(NamedTuple):
    """When to stop, and how much to regularise."""

    tolerance: Array | float  # relative decrease of the cost at which the plan has converged
    max_iterations: Array | int
    damping: Array | float  # added to Quu once a line search has failed
    damping_factor: (
        Array | float
    )  # by which damping grows after a failure and shrinks after a success
    damping_max: Array | float  # where the iteration gives up


class Expansion(NamedTuple):
    """Dynamics to first and state costs to second order about T steps."""

    A: Array  # (T, nx, nx): Jacobians by the state
    B: Array  # (T, nx, nu): Jacobians by the control
    gradients: Array  # (T+1, nx): of the state costs
    hessians: Array  # (T+1, nx, nx): of the state costs, projected to PSD


class Improvement(NamedTuple):
    """The solution of an LQ problem, relative to what it was expanded about."""

    feedforward: Array  # (T, nu): change of the controls
    gains: Array  # (T, nu, nx)
    inverses: Array  # (T, nu, nu): of Quu
    change: Array  # (2,): predicted change of cost s a + s^2 b for a step length s


def charge_weights(horizon: int, at_step_end: bool) -> Array:
    """Returns w (H+1,): the states charged are 1..H at the end of steps, or 0..H-1 at their start."""
    return jnp.ones(horizon + 1).at[0 if at_step_end else horizon].set(0.0)


def state_cost(
    problem: Problem, rate: Callable[[Array], Array], horizon: int, at_step_end: bool
) -> StateCost:
    """Returns (x, k) -> w_k q(x) dt, plus phi(x) at k = H, for a running cost `rate`."""
    return time_varying_cost(
        problem.dt, lambda x, k: rate(x), problem.cost.terminal, horizon, at_step_end
    )


def time_varying_cost(
    dt: Array | float,
    rate: StateCost,
    terminal: Callable[[Array], Array],
    horizon: int,
    at_step_end: bool,
) -> StateCost:
    """Returns (x, k) -> w_k rate(x, k) dt, plus terminal(x) at k = H."""
    weights = charge_weights(horizon, at_step_end)

    def cost(x: Array, k: Array) -> Array:
        return weights[k] * rate(x, k) * dt + jnp.where(k == horizon, terminal(x), 0.0)

    return cost


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
    R, dt = problem.cost.R, problem.dt
    control_gradients = jax.vmap(lambda u: R @ u * dt)(policy.controls)
    lq = expand(problem, cost, policy.states, policy.controls)
    return backward_pass(lq, control_gradients, R * dt, damping)


def expand(problem: Problem, cost: StateCost, states: Array, controls: Array) -> Expansion:
    """Expands dynamics and state costs about states (T+1, nx) and controls (T, nu)."""
    jacobians = jax.jacfwd(
        lambda x, u: euler_step(problem.system, x, u, problem.dt), argnums=(0, 1)
    )
    A, B = jax.vmap(jacobians)(states[:-1], controls)
    steps = jnp.arange(len(states))
    hessians = jax.vmap(nearest_psd)(jax.vmap(jax.hessian(cost))(states, steps))
    return Expansion(A, B, jax.vmap(jax.grad(cost))(states, steps), hessians)


def backward_pass(
    lq: Expansion, control_gradients: Array, weight: Array, damping: Array | float = 0.0
) -> Improvement:
    """Minimises the expanded state costs and g_k' du_k + 1/2 du_k' weight du_k, backwards in time.

    Args:
        lq: the expansion over T steps
        control_gradients: g (T, nu)
        weight: (nu, nu)
        damping: added to the diagonal of Quu where it is inverted
    """

    def step(value: tuple[Array, Array], inputs: tuple) -> tuple[tuple[Array, Array], Improvement]:
        v, V = value
        A, B, q, Q, control_gradient = inputs

        # Expansion of the action value: Tassa et al. 2012, (5).
        Qu = control_gradient + B.T @ v
        Qx = q + A.T @ v
        VB = V @ B
        Quu = symmetrise(weight + B.T @ VB)
        Qux = VB.T @ A

        # Feedforward and gain that minimise it: (6).
        inverse = spd_inverse(Quu + damping * jnp.eye(len(control_gradient)))
        feedforward = -inverse @ Qu
        gain = -inverse @ Qux

        # Value at the step before: (11).
        v = Qx + gain.T @ (Quu @ feedforward + Qu) + Qux.T @ feedforward
        V = symmetrise(Q + A.T @ V @ A + gain.T @ (Quu @ gain + Qux) + Qux.T @ gain)
        change = jnp.array([feedforward @ Qu, 0.5 * feedforward @ Quu @ feedforward])
        return (v, V), Improvement(feedforward, gain, inverse, change)

    last = (lq.gradients[-1], lq.hessians[-1])
    inputs = (lq.A, lq.B, lq.gradients[:-1], lq.hessians[:-1], control_gradients)
    _, improvement = jax.lax.scan(step, last, inputs, reverse=True)
    return improvement._replace(change=jnp.sum(improvement.change, axis=0))


def nearest_psd(hessian: Array) -> Array:
    """Returns the nearest positive semidefinite matrix (nx, nx)."""
    values, vectors = jnp.linalg.eigh(symmetrise(hessian))
    return (vectors * jnp.maximum(values, 0.0)) @ vectors.T


class _SolverState(NamedTuple):
    """What one iteration hands to the next."""

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
