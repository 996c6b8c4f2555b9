"""The LQ problem about a trajectory: expansion and backward pass.

Source: Todorov and Li 2005; Tassa et al. 2012.

    minimise  sum_k c_k(x_k) + g_k' du_k + 1/2 du_k' W du_k

over changes du of the controls, the dynamics expanded to first and the state costs c_k to second
order.

Symbols: H steps of the horizon, T steps of an expansion, nx states, nu controls.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ..discretise import euler_step
from ..numerics.linalg import spd_inverse, symmetrise
from ..problem import Problem

StateCost = Callable[[Array, Array], Array]  # state (nx,), step () -> cost ()


class Expansion(NamedTuple):
    """Holds dynamics to first and state costs to second order about T steps."""

    A: Array  # (T, nx, nx): Jacobians by the state
    B: Array  # (T, nx, nu): Jacobians by the control
    gradients: Array  # (T+1, nx): of the state costs, finite
    hessians: Array  # (T+1, nx, nx): of the state costs, projected to PSD, finite


class Improvement(NamedTuple):
    """Holds the solution of an LQ problem, relative to what it was expanded about."""

    feedforward: Array  # (T, nu): change of the controls
    gains: Array  # (T, nu, nx)
    inverses: Array  # (T, nu, nu): of Quu
    change: Array  # (2,): predicted change of cost s a + s^2 b for a step length s


def charge_weights(horizon: int, at_step_end: bool) -> Array:
    """Returns w (H+1,), which is 0 at the one state that is not charged.

    With `at_step_end` the states 1..H are charged, otherwise 0..H-1.
    """
    return jnp.ones(horizon + 1).at[0 if at_step_end else horizon].set(0.0)


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


def expand(problem: Problem, cost: StateCost, states: Array, controls: Array) -> Expansion:
    """Expands dynamics and state costs about states (T+1, nx) and controls (T, nu).

    A state at which the cost has no finite derivatives, as the distance to a goal has none at the
    goal, counts as if it cost nothing: there the cost is flat.
    """
    jacobians = jax.jacfwd(
        lambda x, u: euler_step(problem.system, x, u, problem.dt), argnums=(0, 1)
    )
    A, B = jax.vmap(jacobians)(states[:-1], controls)
    steps = jnp.arange(len(states))
    gradients = jax.vmap(jax.grad(cost))(states, steps)
    hessians = jax.vmap(nearest_psd)(jax.vmap(jax.hessian(cost))(states, steps))
    return Expansion(A, B, _finite(gradients), _finite(hessians))


def _finite(derivatives: Array) -> Array:
    """Returns the derivatives with zeros where they are not finite."""
    return jnp.where(jnp.isfinite(derivatives), derivatives, 0.0)


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
