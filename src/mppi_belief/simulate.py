"""One closed-loop trial: plan, act, measure, filter. The only loop over real time.

Keys are folds of (seed, trial, role, step). A trial's noise therefore depends on nothing else: not
on the controller (common random numbers), the number of trials, or the process that runs it.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from .belief.kalman import aim_sensor_ahead
from .belief.prior import draw_start
from .discretise import euler_step, measurement_factor
from .numerics.normals import standard_normal
from .problem import Belief, Controller, Filter, Problem, SeesState

# Roles, each with a stream of random numbers of its own.
PLANT = 0
FILTER = 1
PLANNER = 2
INITIAL_DRAW = 2**31 - 1  # folded into a key in place of a step, for draws before step 0


class Trial(NamedTuple):
    """Holds a closed loop of T steps."""

    states: Array  # (T+1, nx)
    beliefs: Belief  # mean (T+1, nx), cov (T+1, nx, nx)
    controls: Array  # (T, nu)
    measurements: Array  # (T, ny), the one that follows each control
    ess: Array  # (T,), effective sample sizes of the controller


def role_key(seed: Array | int, trial: Array | int, role: int) -> Array:
    """Returns the key of one role in one trial."""
    return jax.random.fold_in(jax.random.fold_in(jax.random.key(seed), trial), role)


def simulate_trial(
    problem: Problem, filter: Filter, controller: Controller, seed: Array | int, trial: Array | int
) -> Trial:
    """Runs one trial; a pure function, so it may be jitted and vmapped over `trial`."""
    return closed_loop(problem, filter, controller, seed, trial, lambda info: None)[0]


def closed_loop(
    problem: Problem,
    filter: Filter,
    controller: Controller,
    seed: Array | int,
    trial: Array | int,
    select: Callable[[Any], Any],
) -> tuple[Trial, Any]:
    """Runs one trial and stacks what `select` returns of each step's diagnostics."""
    plant_key, filter_key, planner_key = (
        role_key(seed, trial, role) for role in (PLANT, FILTER, PLANNER)
    )
    # From here on the problem has the prior that filter and controller know.
    first_state, problem = draw_start(problem, jax.random.fold_in(plant_key, INITIAL_DRAW))
    first_belief = filter.init(problem, jax.random.fold_in(filter_key, INITIAL_DRAW))

    def advance(carry: tuple, k: Array) -> tuple[tuple, tuple]:
        x, belief, plan = carry
        known = controller_belief(controller, belief, x)
        u, plan, info = controller.act(problem, known, plan, jax.random.fold_in(planner_key, k))
        x, y, belief = step_plant_and_filter(
            problem, filter, x, belief, u, plant_key, filter_key, k
        )
        step = (x, Belief(belief.mean, belief.cov), u, y, info.ess)
        return (x, belief, plan), (step, select(info))

    carry = (first_state, first_belief, controller.init(problem))
    _, (steps, selected) = jax.lax.scan(advance, carry, jnp.arange(problem.steps))
    later_states, later_beliefs, controls, measurements, ess = steps

    # The start comes before the states and beliefs after each step.
    states = jnp.concatenate([first_state[None], later_states])
    means = jnp.concatenate([first_belief.mean[None], later_beliefs.mean])
    covs = jnp.concatenate([first_belief.cov[None], later_beliefs.cov])
    return Trial(states, Belief(means, covs), controls, measurements, ess), selected


def controller_belief(controller: Controller, belief: Any, x: Array) -> Any:
    """Returns the belief that a controller plans from: the filter's, or that of an oracle.

    An oracle (`sees_state`) gets a belief at x (nx,) without any uncertainty.
    """
    if isinstance(controller, SeesState) and controller.sees_state:
        return Belief(x, jnp.zeros((len(x), len(x)), x.dtype))
    return belief


def step_plant_and_filter(
    problem: Problem,
    filter: Filter,
    x: Array,
    belief: Any,
    u: Array,
    plant_key: Array,
    filter_key: Array,
    k: Array,
) -> tuple[Array, Array, Any]:
    """Carries out step k under control u (nu,), with the sensor turned for the belief.

    Returns the next state (nx,), the measurement (ny,) and the next belief.
    """
    problem = aim_sensor_ahead(problem, belief, u)
    x, y = plant_step(problem, x, u, jax.random.fold_in(plant_key, k))
    return x, y, filter.update(problem, belief, u, y, jax.random.fold_in(filter_key, k))


def plant_step(problem: Problem, x: Array, u: Array, key: Array) -> tuple[Array, Array]:
    """Returns the true state (nx,) after control u (nu,), and the measurement (ny,) taken there."""
    system = problem.system
    state_key, sensor_key = jax.random.split(key)
    w = standard_normal(state_key, (system.H.shape[1],))
    x = euler_step(system, x, u, problem.dt) + system.H @ w * jnp.sqrt(problem.dt)
    factor = measurement_factor(problem, x)
    return x, system.c(x) + factor @ standard_normal(sensor_key, (factor.shape[1],))
