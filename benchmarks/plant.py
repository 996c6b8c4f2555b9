"""Defines the plant that every subject drives, and the interface of a peer's adapter.

    p' = v,  v' = u,  in Euler steps of dt: x = [p_x, p_y, v_x, v_y] in m and m/s, u in m/s^2

The plant is a double integrator without noise. Only the standard library is used, since this module
runs in each peer's own environment.
"""

import math
import time
from typing import Any

# Calls at the start of each round that are not counted: caches are cold after the others' turns.
WARM_UP = 5

Workload = dict[str, Any]


def plant_step(workload: Workload, x: list[float], u: list[float]) -> list[float]:
    """Returns the state (4,) after control u (2,)."""
    dt = workload["dt"]
    (px, py, vx, vy) = x
    return [px + dt * vx, py + dt * vy, vx + dt * u[0], vy + dt * u[1]]


def judge(workload: Workload, path: list[list[float]]) -> dict[str, float]:
    """Returns a path's least and final distance from the goal and its least clearance, in m.

    The distance from the goal is that of states; the clearance is that of the whole path, whose
    steps are straight.
    """
    to_goal = [math.dist(x[:2], workload["goal"][:2]) for x in path]
    apart = math.inf
    for start, end in zip(path, path[1:] or path, strict=False):
        for center in workload["centers"]:
            apart = min(apart, distance_to_line(start[:2], end[:2], center))
    return {
        "nearest": min(to_goal),
        "final_distance": to_goal[-1],
        "clearance": apart - workload["radius"],
    }


def distance_to_line(start: list[float], end: list[float], point: list[float]) -> float:
    """Returns the least distance of a point from the straight line between two others, in m."""
    step = [b - a for a, b in zip(start, end, strict=True)]
    offset = [b - a for a, b in zip(start, point, strict=True)]
    squared = math.fsum(s * s for s in step)
    along = math.fsum(s * o for s, o in zip(step, offset, strict=True))
    part = min(max(along / squared, 0.0), 1.0) if squared > 0 else 0.0
    return math.dist(offset, [part * s for s in step])


class Planner:
    """Represents one controller on the workload. An adapter implements the five methods below.

    settings   one sentence: how the library was set up
    versions   package -> version
    """

    settings = ""

    def __init__(self, workload: Workload, dtype: str) -> None:
        self.workload = workload
        self.dtype = dtype
        self.versions: dict[str, str] = {}
        self._x: list[float] | None = (
            None  # where the timed closed loop stands; None before a trial
        )
        self._step = 0

    def reset(self) -> None:
        """Forgets the plan: the next step is the first of a trial."""
        raise NotImplementedError

    def observe(self, x: list[float]) -> Any:
        """Returns the state in the library's own array type; not timed."""
        raise NotImplementedError

    def act(self, state: Any) -> Any:
        """Computes one control step and waits for its result; this is timed.

        The plan is warm started as the library does it.
        """
        raise NotImplementedError

    def control(self, result: Any) -> list[float]:
        """Returns the result of `act` as numbers (2,); not timed."""
        raise NotImplementedError

    def time(self, calls: int) -> list[float]:
        """Returns the seconds of single control steps in closed loop from the start of a trial."""
        self._x = None
        return [self._timed_step() for _ in range(WARM_UP + calls)][WARM_UP:]

    def _timed_step(self) -> float:
        """Returns the seconds of one step and moves the plant; starts a new trial if necessary."""
        if self._x is None or self._step == self.workload["steps"]:
            self.reset()
            self._x = self.workload["start"]
            self._step = 0
        state = self.observe(self._x)
        started = time.perf_counter()
        result = self.act(state)
        seconds = time.perf_counter() - started
        self._x = plant_step(self.workload, self._x, self.control(result))
        self._step = self._step + 1
        return seconds

    def closed_loop(self) -> dict[str, float]:
        """Runs one trial from start to goal and judges it, see `judge`."""
        self.reset()
        path = [self.workload["start"]]
        for _ in range(self.workload["steps"]):
            path.append(
                plant_step(self.workload, path[-1], self.control(self.act(self.observe(path[-1]))))
            )
        self._x = None
        return judge(self.workload, path)
