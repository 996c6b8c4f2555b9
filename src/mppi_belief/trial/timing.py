"""Measures the Time column: single control steps, alone in their process, compiled and warm."""

import functools
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax

from ..belief.prior import draw_start
from ..results.timing_load import machine_load
from ..simulate import (
    FILTER,
    INITIAL_DRAW,
    PLANNER,
    PLANT,
    controller_belief,
    role_key,
    step_plant_and_filter,
)
from .build import CellParts, build
from .device import computing


class StepTime(NamedTuple):
    """Holds how long one control step took."""

    wall: float  # s
    cpu: float  # s of this process, in all its threads


def time_steps(config: dict[str, Any], calls: int = 200) -> list[float]:
    """Returns wall times (s) of single control steps in closed loop.

    They are compiled and warm, and each is waited for before the next.
    """
    return [step.wall for step in _measured_steps(config, calls)]


def time_steps_and_load(
    config: dict[str, Any], calls: int = 200, load: Callable[[], float] = machine_load
) -> dict[str, Any]:
    """Returns the wall times of control steps with the load under which they were measured.

    The keys are those of timing.json, see `results.timing_load`.
    """
    steps = _measured_steps(config, calls)
    share = sum(step.cpu for step in steps) / sum(step.wall for step in steps)
    return {
        "seconds": [step.wall for step in steps],
        "cpu_share": round(min(share, 1.0), 4) if config["platform"] == "cpu" else None,
        "load": round(load(), 3),
    }


def _measured_steps(config: dict[str, Any], calls: int) -> list[StepTime]:
    """Returns the times of single control steps, over as many trials as it takes."""
    with computing(config):
        parts = jax.device_put(build(config))
        act, respond = _step_functions()
        times: list[StepTime] = []
        trial = 0
        while len(times) < calls:
            times += _time_one_trial(parts, config["seed"], trial, act, respond)
            trial += 1
    return times[:calls]


@functools.cache
def _step_functions() -> tuple[Any, Any]:
    """Returns the compiled control step, without diagnostics, and the compiled rest of a step."""

    def act(problem: Any, controller: Any, belief: Any, plan: Any, key: Any) -> tuple[Any, Any]:
        u, plan, _ = controller.act(problem, belief, plan, key)
        return u, plan

    return jax.jit(act), jax.jit(step_plant_and_filter)


def _time_one_trial(
    parts: CellParts, seed: int, trial: int, act: Any, respond: Any
) -> list[StepTime]:
    """Returns the times of the control steps of one trial."""
    problem, filter, controller = parts
    plant_key = role_key(seed, trial, PLANT)
    filter_key = role_key(seed, trial, FILTER)
    planner_key = role_key(seed, trial, PLANNER)
    x, problem = draw_start(problem, jax.random.fold_in(plant_key, INITIAL_DRAW))
    belief = filter.init(problem, jax.random.fold_in(filter_key, INITIAL_DRAW))
    plan = controller.init(problem)

    # Warm-up: the first call compiles.
    if trial == 0:
        known = controller_belief(controller, belief, x)
        jax.block_until_ready(act(problem, controller, known, plan, planner_key))

    times = []
    for k in range(problem.steps):
        known = controller_belief(controller, belief, x)
        key = jax.random.fold_in(planner_key, k)
        arguments = jax.block_until_ready((problem, controller, known, plan, key))
        cpu_before = time.process_time()
        started = time.perf_counter()
        u, plan = jax.block_until_ready(act(*arguments))
        wall = time.perf_counter() - started
        times.append(StepTime(wall, time.process_time() - cpu_before))
        x, _, belief = respond(problem, filter, x, belief, u, plant_key, filter_key, k)
    return times
