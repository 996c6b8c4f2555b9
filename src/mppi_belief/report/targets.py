"""Evaluates the targets that a structure and its fitted numbers are to meet, on rows of trials.

A target is met or not only once every cell that it speaks of has as many trials as it asks for.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from . import claims, published
from .agreement import AGREEMENT, FITTED, ComparedNumber, compare_numbers
from .cell_results import CellResults, Studies, by_method, paired_rows

MET = "met"
NOT_MET = "not met"
NOT_TESTED = "not tested"

LONG_TRIALS = 2000  # of the study `table_1_long`
LONG_RATE = 0.005  # the highest collision rate in them
AGREEING = 12  # of the fitted numbers, within `AGREEMENT` standard errors
FITTED_NUMBERS = 14  # that the paper publishes
FLAT_FROM = 0.5  # theta from which the clearance is to be flat
FLATNESS = 0.05  # m, between the largest and the smallest clearance


class Target(NamedTuple):
    """Holds a target with the verdict on it."""

    text: str
    verdict: str  # `MET`, `NOT_MET` or `NOT_TESTED`
    number: str  # what was measured; "-" where nothing was


def evaluate_targets(studies: Studies) -> list[Target]:
    """Evaluates every target on Table I, the same over more trials, and both sweeps.

    Cells with other settings than the paper's do not count.
    """
    table_1 = _with_settings(studies.get("table_1", []))
    long_table = _with_settings(studies.get("table_1_long", []))
    theta = _with_settings(studies.get("theta_sweep", []), published.THETA_KEY)
    weights = _with_settings(studies.get("w_obs_sweep", []), published.WEIGHT_KEY)
    numbers = compare_numbers(table_1, theta, weights)
    few = f"MPPI-Belief at theta = 1 collides in 0 of {published.PAPER_TRIALS} trials"
    many = (
        f"MPPI-Belief at theta = 1 collides in at most {100 * LONG_RATE:g} % of "
        f"{LONG_TRIALS} trials"
    )
    return [
        _rate_target(few, table_1, published.PAPER_TRIALS, 0.0),
        _rate_target(many, long_table, LONG_TRIALS, LONG_RATE),
        _fitted_target(numbers),
        _certainty_equivalent_target(table_1, theta),
        _theta_row_target(numbers),
        _flat_target(theta),
        _claim_target(claims.baseline_range_claim(), weights),
        _claim_target(claims.belief_below_claim(), weights),
        _claim_target(claims.belief_free_claim(), weights),
    ]


def targets_frame(targets: Sequence[Target]) -> pd.DataFrame:
    """Returns a line of text per target."""
    return pd.DataFrame(
        {
            "Target": [target.text for target in targets],
            "Verdict": [target.verdict for target in targets],
            "Here": [target.number for target in targets],
        }
    )


def _with_settings(cells: Sequence[CellResults], *varied: str) -> list[CellResults]:
    """Returns the cells with trials whose settings are the paper's, but for the keys `varied`."""
    return [cell for cell in cells if cell.has_paper_settings(*varied) and len(cell.good)]


def _target(text: str, is_met: bool, number: str) -> Target:
    return Target(text, MET if is_met else NOT_MET, number)


def _rate_target(text: str, table_1: Sequence[CellResults], trials: int, highest: float) -> Target:
    """Evaluates the collision rate of MPPI-Belief in at least this many trials."""
    belief = by_method(table_1).get("belief", [])
    if not belief or len(belief[0].rows) < trials:
        return Target(text, NOT_TESTED, "-")
    hits = int(belief[0].collided.sum())
    good = len(belief[0].good)
    return _target(text, hits <= highest * good, f"{hits} of {good} ({100 * hits / good:.2g} %)")


def _fitted_target(numbers: Sequence[ComparedNumber]) -> Target:
    """Evaluates how many of the fitted numbers agree with the paper's."""
    text = f"{AGREEING} of the {FITTED_NUMBERS} fitted numbers within {AGREEMENT:g} standard errors"
    z = [number.z for number in numbers if number.kind == FITTED and math.isfinite(number.z)]
    agreeing = sum(abs(value) <= AGREEMENT for value in z)
    if len(z) < FITTED_NUMBERS:
        return Target(text, NOT_TESTED, f"{agreeing} of {len(z)}" if z else "-")
    return _target(text, agreeing >= AGREEING, f"{agreeing} of {len(z)}")


def _certainty_equivalent_target(
    table_1: Sequence[CellResults], theta: Sequence[CellResults]
) -> Target:
    """Evaluates whether theta = 0 and CE-MPPI agree trial by trial."""
    text = f"theta = 0 within {AGREEMENT:g} standard errors of CE-MPPI, paired"
    neutral = [cell for cell in theta if cell.labels["theta"] == 0]
    certain = by_method(table_1).get("ce", [])
    if not neutral or not certain:
        return Target(text, NOT_TESTED, "-")
    ours, theirs = paired_rows(neutral[0], certain[0])
    if len(ours) < published.PAPER_TRIALS:
        return Target(text, NOT_TESTED, "-")
    z = {
        name: paired_z(ours[name].to_numpy(dtype=float), theirs[name].to_numpy(dtype=float))
        for name in ("cost", "collided", "clearance")
    }
    is_met = all(abs(value) <= AGREEMENT for value in z.values())
    words = [f"{name} z = {value:+.1f}" for name, value in z.items()]
    return _target(text, is_met, ", ".join(words).replace("collided", "collisions"))


def paired_z(first: np.ndarray, second: np.ndarray) -> float:
    """Returns the mean of first - second over pairs (n,) in its standard errors; 0 of equal ones.

    For two arrays of 0 and 1 this is McNemar's statistic but for the term in 1 / n.
    """
    difference = first - second
    if not np.any(difference):
        return 0.0
    error = float(np.std(difference, ddof=1)) / math.sqrt(len(difference))
    mean = float(np.mean(difference))
    return mean / error if error else math.copysign(math.inf, mean)


def _theta_row_target(numbers: Sequence[ComparedNumber]) -> Target:
    """Evaluates whether our row theta = 0 agrees with the paper's."""
    text = f"theta = 0 within {AGREEMENT:g} standard errors of the paper's row"
    row = [number for number in numbers if number.label.startswith("theta 0, ")]
    if not row:
        return Target(text, NOT_TESTED, "-")
    parts = [
        f"{number.label.removeprefix('theta 0, ')} {number.ours} (z = {number.z:+.1f})"
        for number in row
    ]
    return _target(text, all(abs(number.z) <= AGREEMENT for number in row), ", ".join(parts))


def _flat_target(theta: Sequence[CellResults]) -> Target:
    """Evaluates whether the mean clearance is the same over all larger theta."""
    text = f"clearance flat within {FLATNESS:g} m from theta = {FLAT_FROM:g} on"
    wanted = {value for value in published.PAPER_THETA if value >= FLAT_FROM}
    clearances = {
        float(cell.labels["theta"]): float(cell.good["clearance"].mean())
        for cell in theta
        if cell.labels["theta"] in wanted and len(cell.rows) >= published.PAPER_TRIALS
    }
    if clearances.keys() != wanted:
        return Target(text, NOT_TESTED, "-")
    low = min(clearances.values())
    high = max(clearances.values())
    number = f"{low:.3f} to {high:.3f} m, {high - low:.3f} m apart"
    return _target(text, high - low <= FLATNESS, number)


def _claim_target(claim: claims.Claim, weights: Sequence[CellResults]) -> Target:
    """Evaluates a claim on the sweep over the obstacle weight."""
    tested, failing, needed = claims.judge(claim, weights)
    rates = [100 * float(cell.collided.mean()) for cell in tested]
    number = f"{min(rates):.1f} to {max(rates):.1f} %" if rates else "-"
    if failing:
        names = [_weights_text(cells) for cells in by_method(failing).values()]
        return Target(claim.text, NOT_MET, f"{number}; not {'; '.join(names)}")
    return Target(claim.text, NOT_TESTED if needed else MET, number)


def _weights_text(cells: Sequence[CellResults]) -> str:
    """Returns the name of a method and the weights of its cells."""
    weights = ", ".join(f"{cell.labels['w_obs']:g}" for cell in cells)
    return f"{cells[0].name} at {weights}"
