"""Refines the search's best candidate to the nearest minimum, and says what the fit can tell apart.

    python experiments/calibration/refine.py --from 51 --iterations 6

Gauss-Newton with Levenberg-Marquardt damping on Table I's twelve deviations, in coordinates that
run from 0 to 1 over each number's range; derivatives are differences under common random numbers.
J'J at the end is the Fisher information of Table I's numbers, each in units of its own standard
error. With the information of a uniform number in its range added, its inverse gives the standard
error of each open number while the others are free. More digits than that mean nothing.
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


def to_unit(candidate: dict[str, Any]) -> np.ndarray:
    """Returns the open numbers as coordinates (n,) in [0, 1]."""
    return np.array([_unit(scenario.OPEN[name], candidate[name]) for name in NAMES])


def _unit(range: scenario.Range, value: float) -> float:
    """Returns one number as a coordinate in [0, 1]."""
    low, high, log = range
    if log:
        low = math.log(low)
        high = math.log(high)
        value = math.log(value)
    return (value - low) / (high - low)


def from_unit(unit: np.ndarray, steps: int) -> dict[str, Any]:
    """Returns the candidate with the coordinates `unit` (n,); the inverse of `to_unit`."""
    candidate: dict[str, Any] = {"steps": steps}
    for name, part in zip(NAMES, unit, strict=True):
        low, high, log = scenario.OPEN[name]
        value = math.log(low) + part * math.log(high / low) if log else low + part * (high - low)
        candidate[name] = math.exp(value) if log else value
    return candidate


def deviations(steps: int, unit: Sequence[float]) -> tuple[list[float], dict[str, Any]]:
    """Returns Table I's twelve z at a point, and the measured numbers of each method."""
    if not _bases:
        _bases.update(scenario.base_configs())
    candidate = from_unit(np.asarray(unit), steps)
    z = []
    measured = {}
    for method in scenario.METHODS:
        rows = scenario.run(scenario.configure(_bases[method], candidate), range(TRIALS[method]))
        measured[method] = scenario.measure(rows)
        z += scenario.deviations(method, measured[method])
    return z, {method: [round(value, 4) for value in values] for method, values in measured.items()}


def jacobian(
    pool: ProcessPoolExecutor, steps: int, unit: np.ndarray, z: Sequence[float]
) -> np.ndarray:
    """Returns dz / dunit (12, n) at a point with deviations z, by differences in the range."""
    strides = np.where(unit + STEP <= 1, STEP, -STEP)
    points = [(unit + np.eye(len(unit))[i] * stride).tolist() for i, stride in enumerate(strides)]
    shifted = np.array([measured[0] for measured in pool.map(partial(deviations, steps), points)])
    return ((shifted - np.array(z)) / strides[:, None]).T


def refine(
    pool: ProcessPoolExecutor, unit: np.ndarray, steps: int, iterations: int
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the minimum (n,) reached from here, and the Jacobian (12, n) there."""
    z, measured = next(pool.map(partial(deviations, steps), [unit.tolist()]))
    damping = 0.3
    J = jacobian(pool, steps, unit, z)
    for iteration in range(iterations):
        print_iteration(iteration, z, unit, steps, measured)
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
        z, measured = answers[best]
        J = jacobian(pool, steps, unit, z)
    print_iteration(iterations, z, unit, steps, measured)
    return unit, J


def _step(J: np.ndarray, z: np.ndarray, damping: float) -> np.ndarray:
    """Returns the damped Gauss-Newton step (n,)."""
    scale = np.mean(np.sum(J**2, axis=0))
    return -np.linalg.solve(J.T @ J + damping * 0.1 * scale * np.eye(J.shape[1]), J.T @ z)


def print_iteration(
    iteration: int, z: Sequence[float], unit: np.ndarray, steps: int, measured: dict[str, Any]
) -> None:
    candidate = {name: float(f"{value:.4g}") for name, value in from_unit(unit, steps).items()}
    line = {
        "iteration": iteration,
        "loss": round(sum(value**2 for value in z), 1),
        **candidate,
        **measured,
    }
    print(json.dumps(line), flush=True)


def standard_errors(J: np.ndarray, unit: np.ndarray, steps: int) -> dict[str, tuple[float, float]]:
    """Returns each open number with its standard error.

    A direction that Table I does not determine is bounded by the range.
    """
    information = J.T @ J + np.diag(
        np.full(J.shape[1], 12.0)
    )  # a uniform number on [0, 1] has variance 1/12
    error = np.sqrt(np.diag(np.linalg.inv(information)))
    candidate = from_unit(unit, steps)
    shifted_candidate = from_unit(unit + error, steps)
    return {
        name: (candidate[name], abs(shifted_candidate[name] - candidate[name])) for name in NAMES
    }


def start(log: Path, number: int) -> dict[str, Any]:
    """Returns a candidate of the search's log."""
    with log.open() as file:
        row = next(row for row in csv.DictReader(file) if int(row["trial"]) == number)
    return {**{name: float(row[name]) for name in NAMES}, "steps": int(float(row["steps"]))}


def main() -> None:
    """Refines one candidate and prints each number with its standard error."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--from", dest="number", type=int, required=True)
    parser.add_argument("--log", type=Path, default=HERE / "trials.csv")
    parser.add_argument("--iterations", type=int, default=6)
    parser.add_argument("--processes", type=int, default=2)
    args = parser.parse_args()
    environment.prepare()
    candidate = start(args.log, args.number)
    with ProcessPoolExecutor(
        args.processes, get_context("spawn"), initializer=environment.prepare
    ) as pool:
        unit, J = refine(pool, to_unit(candidate), candidate["steps"], args.iterations)
    for name, (value, error) in standard_errors(J, unit, candidate["steps"]).items():
        print(f"{name:18} {value:10.4g} ± {error:.2g}")


if __name__ == "__main__":
    main()
