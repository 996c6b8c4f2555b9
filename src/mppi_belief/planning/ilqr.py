"""Trajectory optimisation by iterated LQ approximation (Todorov and Li 2005; Tassa et al. 2012).

    minimise  sum_{k<H} 1/2 u_k' R u_k dt + sum_{k<=H} w_k q(x_k) dt + phi(x_H),  x_{k+1} = Euler step of (1a)

w_k is 1 but for one end of the horizon, see `charge_weights`. Each iteration expands dynamics to first
and costs to second order about the nominal (state Hessians projected to PSD, so that every backward
pass is well posed), solves the LQ problem, and searches along its direction. Additive noise, also one
whose sensor noise depends on the state, leaves this solution as it is (certainty equivalence).
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

StateCost = Callable[[Array, Array], Array]
HALVINGS = 12  # steps of the line search
SUFFICIENT = 1e-4  # part of the predicted decrease that a step must reach (Armijo)


class Policy(NamedTuple):
    """u_k = controls_k + gains_k (x - states_k): states (H+1, nx), controls (H, nu), gains (H, nu, nx)."""

    states: Array
    controls: Array
    gains: Array


class Solution(NamedTuple):
    """A policy with its cost (), iterations used () and whether they sufficed ()."""

    policy: Policy
    cost: Array
    iterations: Array
    converged: Array


class Info(NamedTuple):
    """Diagnostics: no samples, hence no effective sample size; cost of the plan, iterations, whether converged."""

    ess: Array
    nominal_cost: Array
    iterations: Array
    converged: Array


class Settings(NamedTuple):
    """When to stop: relative decrease of cost, iterations. Regularisation: where it starts, factor, most."""

    tolerance: Array | float
    max_iterations: Array | int
    damping: Array | float
    factor: Array | float
    most: Array | float


def charge_weights(horizon: int, at_step_end: bool) -> Array:
    """w (H+1,): which states of the horizon are charged, 1..H at the end of steps or 0..H-1 at their start."""
    return jnp.ones(horizon + 1).at[0 if at_step_end else horizon].set(0.0)


def state_cost(
    problem: Problem, rate: Callable[[Array], Array], horizon: int, at_step_end: bool
) -> StateCost:
    """(x, k) -> w_k q(x) dt, plus phi(x) at k = H, for a running cost `rate`."""
    return staged(problem.dt, lambda x, k: rate(x), problem.cost.terminal, horizon, at_step_end)


def staged(
    dt: Array | float,
    rate: StateCost,
    terminal: Callable[[Array], Array],
    horizon: int,
    at_step_end: bool,
) -> StateCost:
    """(x, k) -> w_k rate(x, k) dt, plus terminal(x) at k = H."""
    weights = charge_weights(horizon, at_step_end)

    def cost(x: Array, k: Array) -> Array:
        return weights[k] * rate(x, k) * dt + jnp.where(k == horizon, terminal(x), 0.0)

    return cost


def follow(
    problem: Problem,
    policy: Policy,
    start: Array,
    step: Array | float = 0.0,
    feed: Array | None = None,
) -> Policy:
    """The policy's own states and controls from `start` (nx,), its feedforward moved by step * feed (H, nu)."""
    feed = jnp.zeros_like(policy.controls) if feed is None else feed

    def advance(
        x: Array, at: tuple[Array, Array, Array, Array]
    ) -> tuple[Array, tuple[Array, Array]]:
        nominal, u, gain, move = at
        u = u + step * move + gain @ (x - nominal)
        return euler_step(problem.system, x, u, problem.dt), (x, u)

    last, (states, controls) = jax.lax.scan(
        advance, start, (policy.states[:-1], policy.controls, policy.gains, feed)
    )
    return Policy(jnp.concatenate([states, last[None]]), controls, policy.gains)


def total_cost(problem: Problem, cost: StateCost, policy: Policy) -> Array:
    """The objective () of a policy's states and controls."""
    states = jax.vmap(cost)(policy.states, jnp.arange(len(policy.states)))
    controls = jax.vmap(lambda u: 0.5 * quadratic_form(problem.cost.R, u))(policy.controls)
    return jnp.sum(states) + jnp.sum(controls) * problem.dt


class Expansion(NamedTuple):
    """Dynamics to first and costs to second order about T steps: Jacobians A (T, nx, nx) and B (T, nx, nu), of the
    state costs the slopes (T+1, nx) and, projected to PSD, the Hessians (T+1, nx, nx)."""

    A: Array
    B: Array
    slopes: Array
    bends: Array


class Improvement(NamedTuple):
    """Of an LQ problem: feedforward moves (T, nu), gains (T, nu, nx), inverses of Quu (T, nu, nu) and the predicted
    change of cost (2,) for step s: s a + s^2 b."""

    feed: Array
    gains: Array
    inverses: Array
    change: Array


def backward(
    problem: Problem, cost: StateCost, policy: Policy, damping: Array | float = 0.0
) -> Improvement:
    """The LQ problem about a policy, solved."""
    R, dt = problem.cost.R, problem.dt
    slopes = jax.vmap(lambda u: R @ u * dt)(policy.controls)
    return sweep(expand(problem, cost, policy.states, policy.controls), slopes, R * dt, damping)


def expand(problem: Problem, cost: StateCost, states: Array, controls: Array) -> Expansion:
    """About states (T+1, nx) and controls (T, nu)."""
    move = jax.jacfwd(lambda x, u: euler_step(problem.system, x, u, problem.dt), argnums=(0, 1))
    A, B = jax.vmap(move)(states[:-1], controls)
    steps = jnp.arange(len(states))
    bends = jax.vmap(_convex)(jax.vmap(jax.hessian(cost))(states, steps))
    return Expansion(A, B, jax.vmap(jax.grad(cost))(states, steps), bends)


def sweep(lq: Expansion, slopes: Array, weight: Array, damping: Array | float = 0.0) -> Improvement:
    """The least of the expanded state costs and slopes_k' du_k + 1/2 du_k' weight du_k, backwards in time;
    slopes (T, nu), weight (nu, nu), `damping` is added to Quu where it is inverted."""

    def retreat(value: tuple[Array, Array], at: tuple) -> tuple[tuple[Array, Array], Improvement]:
        (v, V), (A, B, q, Q, slope) = value, at
        Qu, Qx = slope + B.T @ v, q + A.T @ v
        VB = V @ B
        Quu, Qux = symmetrise(weight + B.T @ VB), VB.T @ A
        inverse = spd_inverse(Quu + damping * jnp.eye(len(slope)))
        feed, gain = -inverse @ Qu, -inverse @ Qux
        v = Qx + gain.T @ (Quu @ feed + Qu) + Qux.T @ feed
        V = symmetrise(Q + A.T @ V @ A + gain.T @ (Quu @ gain + Qux) + Qux.T @ gain)
        return (v, V), Improvement(
            feed, gain, inverse, jnp.array([feed @ Qu, 0.5 * feed @ Quu @ feed])
        )

    end = (lq.slopes[-1], lq.bends[-1])
    _, found = jax.lax.scan(
        retreat, end, (lq.A, lq.B, lq.slopes[:-1], lq.bends[:-1], slopes), reverse=True
    )
    return found._replace(change=jnp.sum(found.change, axis=0))


def _convex(hessian: Array) -> Array:
    """The nearest PSD matrix, of (nx, nx)."""
    values, vectors = jnp.linalg.eigh(symmetrise(hessian))
    return (vectors * jnp.maximum(values, 0.0)) @ vectors.T


def solve(
    problem: Problem, cost: StateCost, guess: Policy, start: Array, settings: Settings
) -> Solution:
    """Iterate from the guess, followed from `start` (nx,), until the cost's relative decrease is below tolerance."""
    first = follow(problem, guess, start)
    State = tuple[Policy, Array, Array, Array, Array]

    def going(state: State) -> Array:
        _, _, damping, count, converged = state
        return (count < settings.max_iterations) & ~converged & (damping < settings.most)

    def iterate(state: State) -> State:
        policy, best, damping, count, _ = state
        feed, gains, _, change = backward(problem, cost, policy, damping)
        closed, steps = policy._replace(gains=gains), 0.5 ** jnp.arange(HALVINGS, dtype=best.dtype)
        trials = jax.vmap(lambda s: follow(problem, closed, policy.states[0], s, feed))(steps)
        costs = jax.vmap(lambda trial: total_cost(problem, cost, trial))(trials)
        predicted = steps * change[0] + steps**2 * change[1]
        good = costs - best <= SUFFICIENT * predicted
        chosen = jnp.argmax(good)  # the longest step that is good enough
        found = good[chosen] & jnp.isfinite(costs[chosen])
        small = jnp.abs(change[0] + change[1]) <= settings.tolerance * (1.0 + jnp.abs(best))
        policy = jax.tree.map(lambda new, old: jnp.where(found, new[chosen], old), trials, policy)
        policy = policy._replace(gains=gains)
        damping = jnp.where(
            found,
            damping / settings.factor,
            jnp.maximum(damping, settings.damping) * settings.factor,
        )
        damping = jnp.where(damping < settings.damping, 0.0, damping)
        return policy, jnp.where(found, costs[chosen], best), damping, count + 1, small

    state = (
        first,
        total_cost(problem, cost, first),
        jnp.zeros(()),
        jnp.zeros((), int),
        jnp.zeros((), bool),
    )
    policy, best, _, count, converged = jax.lax.while_loop(going, iterate, state)
    return Solution(policy, best, count, converged)


def still(problem: Problem, horizon: int) -> Policy:
    """No control and no feedback, from the prior mean."""
    nx, nu = len(problem.prior_mean), problem.cost.R.shape[0]
    rest = Policy(
        jnp.zeros((horizon + 1, nx)), jnp.zeros((horizon, nu)), jnp.zeros((horizon, nu, nx))
    )
    return follow(problem, rest, prior(problem).mean)


def shifted(policy: Policy) -> Policy:
    """The policy one step later; its last step is held without control."""
    states = jnp.concatenate([policy.states[1:], policy.states[-1:]])
    controls, gains = (jnp.concatenate([part[1:], jnp.zeros_like(part[:1])]) for part in policy[1:])
    return Policy(states, controls, gains)
