"""Describes the numbers that the paper leaves open, and runs Table I's methods under them."""

import argparse
import csv
import functools
from collections.abc import Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mppi_belief.config.compose import collect
from mppi_belief.config.request import Request
from mppi_belief.report import published
from mppi_belief.report.statistics import mean_z, proportion_z, spread_z
from structure import CHOICES, set_structure, shown

METHODS = tuple(published.TABLE_1)
Candidate = dict[str, Any]  # a choice of each of `CHOICES`, a value of each open number
SEED = 1  # the studies use seed 0: what is fitted to noise here does not help there


class Range(NamedTuple):
    """Holds the range in which a number is searched."""

    low: float
    high: float
    log: bool = False  # search on a logarithmic scale


OPEN = {
    "start_x": Range(-1.0, 2.0),  # m
    "start_y": Range(0.0, 2.5),  # m; the scene is symmetric
    "goal_x": Range(6.0, 9.0),  # m
    "prior_std": Range(0.05, 0.6),  # m
    "q_position": Range(0.3, 5.0, log=True),
    "q_velocity": Range(0.03, 3.0, log=True),
    "terminal_position": Range(0.5, 100.0, log=True),
    "terminal_velocity": Range(0.02, 20.0, log=True),
    "r": Range(0.005, 1.0, log=True),
    "width": Range(0.15, 0.6),  # m, of bumps
    "margin": Range(0.02, 0.6),  # m, of penalties of compact support
    "w_obs": Range(100.0, 20_000.0, log=True),
    "control_std": Range(0.7, 6.0, log=True),  # m/s^2
}


@functools.cache
def base_configs() -> dict[str, dict[str, Any]]:
    """Returns the composed configuration of each method, once per process; not to be changed."""
    return {
        method: collect(Request((f"controller={method}", f"seed={SEED}")))[0] for method in METHODS
    }


def is_open(name: str, candidate: Candidate) -> bool:
    """Says whether a number has a meaning for the structure of a candidate."""
    if name in ("width", "margin"):
        return (name == "width") == (candidate["penalty"] == "bump")
    return name != "control_std" or candidate["sampling"] == "free"


def open_names(candidate: Candidate) -> list[str]:
    """Returns the names of the n numbers that are open in the structure of a candidate."""
    return [name for name in OPEN if is_open(name, candidate)]


def logged_candidate(log: Path, number: int) -> Candidate:
    """Returns a candidate of the search's log."""
    with log.open() as file:
        row = next(row for row in csv.DictReader(file) if int(row["trial"]) == number)
    candidate: Candidate = {}
    for name, options in CHOICES.items():
        candidate[name] = next(option for option in options if shown(option) == row[name])
    return candidate | {name: float(row[name]) for name in open_names(candidate)}


def candidate_parser(description: str) -> argparse.ArgumentParser:
    """Returns a parser of what a script needs that starts from one candidate of a log."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("--from", dest="number", type=int, required=True)
    parser.add_argument("--log", type=Path, default=Path(__file__).parent / "trials.csv")
    parser.add_argument("--processes", type=int, default=2)
    return parser


def configure(base: dict[str, Any], candidate: Candidate) -> dict[str, Any]:
    """Returns a method's configuration with the choices and the open numbers of a candidate."""
    config = deepcopy(base)
    config["problem"] |= {
        "prior_mean": [candidate["start_x"], candidate["start_y"], 0.0, 0.0],
        "prior_std": [candidate["prior_std"]] * 2 + [0.05] * 2,
    }
    config["cost"] |= {
        "goal": [candidate["goal_x"], 0.0, 0.0, 0.0],
        "running_weight": [candidate["q_position"]] * 2 + [candidate["q_velocity"]] * 2,
        "terminal_weight": [candidate["terminal_position"]] * 2
        + [candidate["terminal_velocity"]] * 2,
        "control_weight": [candidate["r"]] * 2,
        "w_obs": candidate["w_obs"],
    }
    set_structure(config, candidate)
    return config


def run(config: dict[str, Any], trials: Sequence[int]) -> list[dict[str, Any]]:
    """Returns the rows of these trials."""
    from mppi_belief.trial import KEPT_PATHS, run_trials

    return run_trials(config, [KEPT_PATHS + trial for trial in trials]).rows


class Measured(NamedTuple):
    """Holds the measured counterparts of Table I's numbers for one method."""

    cost: float
    spread: float
    collision_rate: float
    final_distance: float
    clearance: float


def measure(rows: Sequence[dict[str, Any]]) -> Measured:
    """Returns averages over rows; a diverged trial makes them NaN."""
    cost = np.array([row["cost"] for row in rows])
    if not all(row["status"] == "ok" for row in rows):
        return Measured(*[float("nan")] * 5)
    hits = np.mean([row["collided"] for row in rows])
    far = np.mean([row["final_distance"] for row in rows])
    clear = np.mean([row["clearance"] for row in rows])
    return Measured(
        float(cost.mean()), float(cost.std(ddof=1)), float(hits), float(far), float(clear)
    )


def deviations(
    method: str, measured: Measured, n: int = published.PAPER_TRIALS
) -> tuple[float, float, float]:
    """Returns z of cost, spread and collision rate against Table I, as if measured on n trials."""
    row = published.TABLE_1[method]
    m = published.PAPER_TRIALS
    return (
        mean_z(measured.cost, measured.spread, n, row.cost, row.spread, m),
        spread_z(measured.spread, n, row.spread, m),
        proportion_z(measured.collision_rate * n, n, row.collisions, m),
    )
