"""The Time column: one control step, alone in its process, compiled and warm."""

import functools
import time
from typing import Any

import jax

from ..belief.prior import sample_prior
from ..simulate import (
    FILTER,
    INITIAL_DRAW,
    PLANNER,
    PLANT,
    controller_belief,
    role_key,
    step_plant_and_filter,
)
from .build import Experiment, build
from .device import computing


def time_steps(config: dict[str, Any], calls: int = 200) -> list[float]:
    """Wall times (s) of single control steps in closed loop, compiled, after warm-up, each waited for."""
    with computing(config):
        parts = jax.device_put(build(config))
        act, rest = _step_functions()
        times: list[float] = []
        trial = 0
        while len(times) < calls:
            times += _time_one_trial(parts, config["seed"], trial, act, rest)
            trial += 1
    return times[:calls]


@functools.cache
def _step_functions() -> tuple[Any, Any]:
    act = jax.jit(
        lambda problem, controller, belief, plan, key: controller.act(problem, belief, plan, key)[
            :2
        ]
    )
    return act, jax.jit(step_plant_and_filter)


def _time_one_trial(parts: Experiment, seed: int, trial: int, act: Any, rest: Any) -> list[float]:
    problem, filter, controller = parts
    keys = [role_key(seed, trial, role) for role in (PLANT, FILTER, PLANNER)]
    x = sample_prior(problem, jax.random.fold_in(keys[PLANT], INITIAL_DRAW))
    belief = filter.init(problem, jax.random.fold_in(keys[FILTER], INITIAL_DRAW))
    plan, times = controller.init(problem), []
    if trial == 0:
        jax.block_until_ready(
            act(problem, controller, controller_belief(controller, belief, x), plan, keys[PLANNER])
        )
    for k in range(problem.steps):
        args = jax.block_until_ready(
            (
                problem,
                controller,
                controller_belief(controller, belief, x),
                plan,
                jax.random.fold_in(keys[PLANNER], k),
            )
        )
        started = time.perf_counter()
        u, plan = jax.block_until_ready(act(*args))
        times.append(time.perf_counter() - started)
        x, _, belief = rest(problem, filter, x, belief, u, keys[PLANT], keys[FILTER], k)
    return times
