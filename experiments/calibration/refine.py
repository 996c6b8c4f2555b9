"""Refines the search's best candidate to the nearest minimum, and says what the fit can tell apart.

    python experiments/calibration/refine.py --from 51 --iterations 6

Gauss-Newton with Levenberg-Marquardt damping on Table I's twelve deviations, in coordinates that
run from 0 to 1 over each number's range; derivatives are differences under common random numbers.
The candidate's structure, its discrete choices, stays as it is.
J'J at the end is the Fisher information of Table I's numbers, each in units of its own standard
error. With the information of a uniform number in its range added, its inverse gives the standard
error of each open number while the others are free. More digits than that mean nothing.
"""

import json
import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np

import scenario
import structure
from mppi_belief.config import environment

TRIALS = {"belief": 100, "ce": 100, "ilqg": 100, "pipf": 40}
STEP = 0.04


def to_unit(candidate: scenario.Candidate) -> np.ndarray:
    """Returns the open numbers as coordinates (n,) in [0, 1]."""
    return np.array(
        [_unit(scenario.OPEN[name], candidate[name]) for name in scenario.open_names(candidate)]
    )


def _unit(range: scenario.Range, value: float) -> float:
    """Returns one number as a coordinate in [0, 1]."""
    low, high, log = range
    if log:
        low = math.log(low)
        high = math.log(high)
        value = math.log(value)
    return (value - low) / (high - low)


def from_unit(unit: np.ndarray, start: scenario.Candidate) -> scenario.Candidate:
    """Returns the candidate with the coordinates `unit` (n,) and the structure of another one."""
    candidate = {name: start[name] for name in structure.CHOICES}
    for name, part in zip(scenario.open_names(start), unit, strict=True):
        low, high, log = scenario.OPEN[name]
        value = math.log(low) + part * math.log(high / low) if log else low + part * (high - low)
        candidate[name] = math.exp(value) if log else value
    return candidate


def deviations(
    start: scenario.Candidate, unit: Sequence[float]
) -> tuple[list[float], dict[str, Any]]:
    """Returns Table I's twelve z at a point, and the measured numbers of each method."""
    bases = scenario.base_configs()
    candidate = from_unit(np.asarray(unit), start)
    z = []
    measured = {}
    for method in scenario.METHODS:
        rows = scenario.run(scenario.configure(bases[method], candidate), range(TRIALS[method]))
        measured[method] = scenario.measure(rows)
        z += scenario.deviations(method, measured[method])
    return z, {method: [round(value, 4) for value in values] for method, values in measured.items()}


def jacobian(
    pool: ProcessPoolExecutor, start: scenario.Candidate, unit: np.ndarray, z: Sequence[float]
) -> np.ndarray:
    """Returns dz / dunit (12, n) at a point with deviations z, by differences in the range."""
    strides = np.where(unit + STEP <= 1, STEP, -STEP)
    points = [(unit + np.eye(len(unit))[i] * stride).tolist() for i, stride in enumerate(strides)]
    shifted = np.array([measured[0] for measured in pool.map(partial(deviations, start), points)])
    return ((shifted - np.array(z)) / strides[:, None]).T


def refine(
    pool: ProcessPoolExecutor, unit: np.ndarray, start: scenario.Candidate, iterations: int
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the minimum (n,) reached from here, and the Jacobian (12, n) there."""
    z, measured = next(pool.map(partial(deviations, start), [unit.tolist()]))
    damping = 0.3
    J = jacobian(pool, start, unit, z)
    for iteration in range(iterations):
        print_iteration(iteration, z, unit, start, measured)
        dampings = [damping * factor for factor in (0.1, 1.0, 10.0, 100.0)]
        tried = [np.clip(unit + _step(J, np.array(z), each), 0, 1) for each in dampings]
        answers = list(pool.map(partial(deviations, start), [point.tolist() for point in tried]))
        losses = [sum(value**2 for value in answer[0]) for answer in answers]
        best = int(np.nanargmin(losses))
        if not losses[best] < sum(value**2 for value in z):
            damping *= 100
            continue
        unit = tried[best]
        damping = dampings[best]
        z, measured = answers[best]
        J = jacobian(pool, start, unit, z)
    print_iteration(iterations, z, unit, start, measured)
    return unit, J


def _step(J: np.ndarray, z: np.ndarray, damping: float) -> np.ndarray:
    """Returns the damped Gauss-Newton step (n,)."""
    scale = np.mean(np.sum(J**2, axis=0))
    return -np.linalg.solve(J.T @ J + damping * 0.1 * scale * np.eye(J.shape[1]), J.T @ z)


def print_iteration(
    iteration: int,
    z: Sequence[float],
    unit: np.ndarray,
    start: scenario.Candidate,
    measured: dict[str, Any],
) -> None:
    candidate = from_unit(unit, start)
    candidate |= {name: float(f"{candidate[name]:.4g}") for name in scenario.open_names(start)}
    line = {
        "iteration": iteration,
        "loss": round(sum(value**2 for value in z), 1),
        **candidate,
        **measured,
    }
    print(json.dumps(line), flush=True)


def standard_errors(
    J: np.ndarray, unit: np.ndarray, start: scenario.Candidate
) -> dict[str, tuple[float, float]]:
    """Returns each open number with its standard error.

    A direction that Table I does not determine is bounded by the range.
    """
    information = J.T @ J + np.diag(
        np.full(J.shape[1], 12.0)
    )  # a uniform number on [0, 1] has variance 1/12
    error = np.sqrt(np.diag(np.linalg.inv(information)))
    candidate = from_unit(unit, start)
    shifted_candidate = from_unit(unit + error, start)
    return {
        name: (candidate[name], abs(shifted_candidate[name] - candidate[name]))
        for name in scenario.open_names(start)
    }


def main() -> None:
    """Refines one candidate and prints each number with its standard error."""
    parser = scenario.candidate_parser(__doc__)
    parser.add_argument("--iterations", type=int, default=6)
    args = parser.parse_args()
    environment.prepare()
    candidate = scenario.logged_candidate(args.log, args.number)
    with ProcessPoolExecutor(
        args.processes, get_context("spawn"), initializer=environment.prepare
    ) as pool:
        unit, J = refine(pool, to_unit(candidate), candidate, args.iterations)
    for name, (value, error) in standard_errors(J, unit, candidate).items():
        print(f"{name:18} {value:10.4g} ± {error:.2g}")


if __name__ == "__main__":
    main()
