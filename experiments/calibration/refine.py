"""From the search's best candidate to the nearest minimum, and what the fit can tell apart there.

    python experiments/calibration/refine.py --from 51 --iterations 6

Gauss-Newton with Levenberg-Marquardt damping on Table I's twelve deviations, in coordinates that run from 0 to 1
over each number's range; derivatives by differences under common random numbers. J'J at the end is the
Fisher information of Table I's numbers (each is in units of its own standard error); with that of a number
that may be anywhere in its range added, its inverse gives the standard error of each open number, the others free:
more digits than that mean nothing.
"""

import argparse
import csv
import json
import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

import scenario
from mppi_belief.config import environment

HERE = Path(__file__).parent
NAMES = tuple(scenario.OPEN)
TRIALS = {"belief": 100, "ce": 100, "ilqg": 100, "pipf": 40}
STEP = 0.04
_bases: dict[str, dict[str, Any]] = {}


def to_unit(at: dict[str, Any]) -> np.ndarray:
    """Open numbers as coordinates in [0, 1]."""
    return np.array([_unit(scenario.OPEN[name], at[name]) for name in NAMES])


def _unit(range: scenario.Range, value: float) -> float:
    low, high, log = range
    if log:
        low = math.log(low)
        high = math.log(high)
        value = math.log(value)
    return (value - low) / (high - low)


def from_unit(unit: np.ndarray, steps: int) -> dict[str, Any]:
    """The other way."""
    at: dict[str, Any] = {"steps": steps}
    for name, part in zip(NAMES, unit, strict=True):
        low, high, log = scenario.OPEN[name]
        value = math.log(low) + part * math.log(high / low) if log else low + part * (high - low)
        at[name] = math.exp(value) if log else value
    return at


def deviations(steps: int, unit: Sequence[float]) -> tuple[list[float], dict[str, Any]]:
    """Table I's twelve z at a point, and what was measured."""
    if not _bases:
        _bases.update(scenario.base_configs())
    at = from_unit(np.asarray(unit), steps)
    z = []
    found = {}
    for method in scenario.METHODS:
        rows = scenario.run(scenario.configure(_bases[method], at), range(TRIALS[method]))
        found[method] = scenario.measure(rows)
        z += scenario.deviations(method, found[method])
    return z, {method: [round(value, 4) for value in values] for method, values in found.items()}


def jacobian(
    pool: ProcessPoolExecutor, steps: int, unit: np.ndarray, z: Sequence[float]
) -> np.ndarray:
    """d z / d unit (12, n) at a point whose deviations are z, by differences into the range."""
    strides = np.where(unit + STEP <= 1, STEP, -STEP)
    points = [(unit + np.eye(len(unit))[i] * stride).tolist() for i, stride in enumerate(strides)]
    ahead = np.array([found[0] for found in pool.map(partial(deviations, steps), points)])
    return ((ahead - np.array(z)) / strides[:, None]).T


def refine(
    pool: ProcessPoolExecutor, unit: np.ndarray, steps: int, iterations: int
) -> tuple[np.ndarray, np.ndarray]:
    """The minimum found from here, and the Jacobian there."""
    z, found = next(pool.map(partial(deviations, steps), [unit.tolist()]))
    damping = 0.3
    J = jacobian(pool, steps, unit, z)
    for iteration in range(iterations):
        _say(iteration, z, unit, steps, found)
        dampings = [damping * factor for factor in (0.1, 1.0, 10.0, 100.0)]
        tried = [np.clip(unit + _step(J, np.array(z), each), 0, 1) for each in dampings]
        answers = list(pool.map(partial(deviations, steps), [point.tolist() for point in tried]))
        losses = [sum(value**2 for value in answer[0]) for answer in answers]
        best = int(np.nanargmin(losses))
        if not losses[best] < sum(value**2 for value in z):
            damping *= 100
            continue
        unit = tried[best]
        damping = dampings[best]
        (z, found) = answers[best]
        J = jacobian(pool, steps, unit, z)
    _say(iterations, z, unit, steps, found)
    return unit, J


def _step(J: np.ndarray, z: np.ndarray, damping: float) -> np.ndarray:
    scale = np.mean(np.sum(J**2, axis=0))
    return -np.linalg.solve(J.T @ J + damping * 0.1 * scale * np.eye(J.shape[1]), J.T @ z)


def _say(
    iteration: int, z: Sequence[float], unit: np.ndarray, steps: int, found: dict[str, Any]
) -> None:
    at = {name: float(f"{value:.4g}") for name, value in from_unit(unit, steps).items()}
    line = {"iteration": iteration, "loss": round(sum(value**2 for value in z), 1), **at, **found}
    print(json.dumps(line), flush=True)


def standard_errors(J: np.ndarray, unit: np.ndarray, steps: int) -> dict[str, tuple[float, float]]:
    """Each number with its standard error; a direction that Table I says nothing of is bounded by the range."""
    information = J.T @ J + np.diag(
        np.full(J.shape[1], 12.0)
    )  # a uniform number on [0, 1] has variance 1/12
    error = np.sqrt(np.diag(np.linalg.inv(information)))
    at = from_unit(unit, steps)
    other = from_unit(unit + error, steps)
    return {name: (at[name], abs(other[name] - at[name])) for name in NAMES}


def start(log: Path, number: int) -> dict[str, Any]:
    """A candidate of the search's log."""
    with log.open() as file:
        row = next(row for row in csv.DictReader(file) if int(row["trial"]) == number)
    return {**{name: float(row[name]) for name in NAMES}, "steps": int(float(row["steps"]))}


def main() -> None:
    """Refine one candidate and print what the fit can tell apart."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--from", dest="number", type=int, required=True)
    parser.add_argument("--log", type=Path, default=HERE / "trials.csv")
    parser.add_argument("--iterations", type=int, default=6)
    parser.add_argument("--processes", type=int, default=2)
    args = parser.parse_args()
    environment.prepare()
    at = start(args.log, args.number)
    with ProcessPoolExecutor(
        args.processes, get_context("spawn"), initializer=environment.prepare
    ) as pool:
        unit, J = refine(pool, to_unit(at), at["steps"], args.iterations)
    for name, (value, error) in standard_errors(J, unit, at["steps"]).items():
        print(f"{name:18} {value:10.4g} ± {error:.2g}")


if __name__ == "__main__":
    main()
