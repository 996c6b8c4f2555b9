"""One closed-loop trial: measure, filter, plan, act. The only loop over real time.

Keys are folds of (seed, trial, role, step), so a trial's noise depends on nothing else: not on the
controller (common random numbers), the number of trials, or who runs it when.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from .belief.kalman import aimed_ahead
from .belief.prior import sample_prior
from .discretise import euler_step, measurement_factor
from .numerics.normals import standard_normal
from .problem import Belief, Controller, Filter, Problem

PLANT, FILTER, PLANNER = range(3)
BEFORE = 2**31 - 1  # the step of what is drawn before step 0


class Trial(NamedTuple):
    """A closed loop of T steps: states (T+1, nx), beliefs (mean (T+1, nx), cov (T+1, nx, nx)), controls
    (T, nu), measurements (T, ny), effective sample sizes (T,)."""

    states: Array
    beliefs: Belief
    controls: Array
    measurements: Array
    ess: Array


def role_key(seed: Array | int, trial: Array | int, role: int) -> Array:
    """The key of one role in one trial."""
    return jax.random.fold_in(jax.random.fold_in(jax.random.key(seed), trial), role)


def simulate_trial(
    problem: Problem, filter: Filter, controller: Controller, seed: Array | int, trial: Array | int
) -> Trial:
    """Run one trial; pure, so it may be jitted and vmapped over `trial`."""
    return closed_loop(problem, filter, controller, seed, trial, lambda info: None)[0]


def closed_loop(
    problem: Problem,
    filter: Filter,
    controller: Controller,
    seed: Array | int,
    trial: Array | int,
    note: Callable[[Any], Any],
) -> tuple[Trial, Any]:
    """The same, and what `note` makes of each step's diagnostics, stacked over the steps."""
    plant, filtering, planning = (role_key(seed, trial, role) for role in (PLANT, FILTER, PLANNER))
    start = sample_prior(problem, jax.random.fold_in(plant, BEFORE))
    first = filter.init(problem, jax.random.fold_in(filtering, BEFORE))

    def advance(carry: tuple, k: Array) -> tuple[tuple, tuple]:
        x, belief, plan = carry
        told = seen(controller, belief, x)
        u, plan, info = controller.act(problem, told, plan, jax.random.fold_in(planning, k))
        x, y, belief = respond(problem, filter, x, belief, u, plant, filtering, k)
        return (x, belief, plan), ((x, Belief(belief.mean, belief.cov), u, y, info.ess), note(info))

    carry = (start, first, controller.init(problem))
    _, (steps, notes) = jax.lax.scan(advance, carry, jnp.arange(problem.steps))
    states, beliefs, controls, measurements, ess = steps
    states = jnp.concatenate([start[None], states])
    beliefs = Belief(
        *(
            jnp.concatenate([a[None], b])
            for a, b in zip((first.mean, first.cov), beliefs, strict=True)
        )
    )
    return Trial(states, beliefs, controls, measurements, ess), notes


def seen(controller: Controller, belief: Any, x: Array) -> Any:
    """What a controller is told: its belief or, if it is an oracle (`sees_state`), the true state (nx,)."""
    if getattr(controller, "sees_state", False):
        return Belief(x, jnp.zeros((len(x), len(x)), x.dtype))
    return belief


def respond(
    problem: Problem,
    filter: Filter,
    x: Array,
    belief: Any,
    u: Array,
    plant: Array,
    filtering: Array,
    k: Array,
) -> tuple[Array, Array, Any]:
    """What step k answers to control u: the next state (nx,), the measurement (ny,), the next belief."""
    problem = aimed_ahead(problem, belief, u)
    x, y = plant_step(problem, x, u, jax.random.fold_in(plant, k))
    return x, y, filter.update(problem, belief, u, y, jax.random.fold_in(filtering, k))


def plant_step(problem: Problem, x: Array, u: Array, key: Array) -> tuple[Array, Array]:
    """The true state (nx,) after control u (nu,), and the measurement (ny,) taken there."""
    system, dt = problem.system, problem.dt
    state_key, sensor_key = jax.random.split(key)
    w = standard_normal(state_key, (system.H.shape[1],))
    x = euler_step(system, x, u, dt) + system.H @ w * jnp.sqrt(dt)
    factor = measurement_factor(system, x, dt)
    return x, system.c(x) + factor @ standard_normal(sensor_key, (factor.shape[1],))
