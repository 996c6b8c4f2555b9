"""Compares every number that the paper publishes of Table I and its sweeps with ours."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from . import published
from .cell_results import CellResults
from .statistics import holm_adjusted, mean_z, proportion_z, spread_z, two_sided_p
from .summary import TrialSummary, summarise_trials

FITTED = "fitted"  # numbers to which the calibration was fitted
HELD_OUT = "held out"  # predictions
AGREEMENT = 2.0  # standard errors within which two numbers count as agreeing


class ComparedNumber(NamedTuple):
    """Holds one published number and ours."""

    kind: str  # `FITTED` or `HELD_OUT`
    label: str
    paper: str
    ours: str
    z: float  # the difference in standard errors
    is_range: bool = False  # whether the paper gives a range; then z = 0 within it
    p: float = math.nan  # of equal numbers, adjusted by Holm's method for all that are compared


def compare_numbers(
    table_1: Sequence[CellResults], theta: Sequence[CellResults], weights: Sequence[CellResults]
) -> list[ComparedNumber]:
    """Compares every number that Table I, the theta sweep and the obstacle-weight sweep publish.

    Cells with other settings than the paper's are left out.
    """
    numbers: list[ComparedNumber] = []
    for cell in table_1:
        numbers.extend(_compare_table_1(cell, summarise_trials(cell.rows, None)))
    for cell in theta:
        numbers.extend(_compare_theta(cell, summarise_trials(cell.rows, None)))
    for cell in weights:
        numbers.extend(_compare_weight(cell, summarise_trials(cell.rows, None)))
    adjusted = holm_adjusted([two_sided_p(number.z) for number in numbers])
    return [number._replace(p=p) for number, p in zip(numbers, adjusted, strict=True)]


def _compare_table_1(cell: CellResults, ours: TrialSummary) -> Iterator[ComparedNumber]:
    """Compares cost, spread and collisions of one cell with Table I."""
    paper = published.TABLE_1.get(cell.method)
    n = published.PAPER_TRIALS
    if paper is None or ours.good < 2 or not cell.has_paper_settings():
        return
    z = mean_z(ours.cost.value, ours.sd, ours.good, paper.cost, paper.spread, n)
    cost = f"{ours.cost.value:.1f}"
    yield ComparedNumber(FITTED, f"{cell.name}, cost", f"{paper.cost}", cost, z)

    z = spread_z(ours.sd, ours.good, paper.spread, n)
    label = f"{cell.name}, spread of the cost"
    yield ComparedNumber(FITTED, label, f"{paper.spread}", f"{ours.sd:.1f}", z)

    rate = paper.collisions / n
    yield _compare_rate(FITTED, f"{cell.name}, collisions %", ours, rate, rate)


def _compare_theta(cell: CellResults, ours: TrialSummary) -> Iterator[ComparedNumber]:
    """Compares one cell of the theta sweep with the text. Ours stands for spreads it omits."""
    theta = float(cell.labels["theta"])
    paper = published.PAPER_THETA.get(theta)
    n = published.PAPER_TRIALS
    if paper is None or ours.good < 2 or not cell.has_paper_settings(published.THETA_KEY):
        return
    kind = FITTED if theta == published.TABLE_1_THETA else HELD_OUT  # the former is in Table I too
    yield _compare_rate(kind, f"theta {theta:g}, collisions %", ours, *paper.collision_rate)

    if paper.clearance is not None:
        values = cell.good["clearance"].to_numpy(dtype=float)
        sd = float(np.std(values, ddof=1)) if np.all(np.isfinite(values)) else math.nan
        z = mean_z(ours.clearance.value, sd, ours.good, paper.clearance, sd, n)
        label = f"theta {theta:g}, clearance m"
        clearance = f"{ours.clearance.value:.2f}"
        yield ComparedNumber(HELD_OUT, label, f"{paper.clearance:.2f}", clearance, z)

    if paper.cost is not None:
        z = mean_z(ours.cost.value, ours.sd, ours.good, paper.cost, ours.sd, n)
        cost = f"{ours.cost.value:.1f}"
        yield ComparedNumber(kind, f"theta {theta:g}, cost", f"{paper.cost}", cost, z)


def _compare_weight(cell: CellResults, ours: TrialSummary) -> Iterator[ComparedNumber]:
    """Compares the collisions of one cell of the obstacle-weight sweep with the text."""
    w_obs = float(cell.labels["w_obs"])
    label = f"w_obs {w_obs:g}, {cell.name}, collisions %"
    lowest, highest = published.WEIGHT_RANGE
    is_published = cell.has_paper_settings(published.WEIGHT_KEY) and lowest <= w_obs <= highest
    if ours.good < 2 or not is_published:
        return
    if cell.method in published.BASELINES:
        yield _compare_rate(HELD_OUT, label, ours, *published.BASELINE_RANGE)
    elif cell.method == "belief":
        bound = published.belief_rate_bound(w_obs)
        if bound is not None:
            yield _compare_rate(HELD_OUT, label, ours, 0.0, bound)


def _compare_rate(
    kind: str, label: str, ours: TrialSummary, low: float, high: float
) -> ComparedNumber:
    """Compares a collision rate with the nearest rate in the paper's range; z = 0 within it."""
    rate = ours.collided.value
    n = published.PAPER_TRIALS
    nearest = min(max(rate, low), high)
    z = proportion_z(ours.collisions, ours.good, nearest * n, n)
    is_range = low != high
    paper = f"{100 * low:g} to {100 * high:g}" if is_range else f"{100 * low:.1f}"
    return ComparedNumber(kind, label, paper, f"{100 * rate:.1f}", z, is_range)
