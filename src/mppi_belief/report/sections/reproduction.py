"""How well each published number is met: Table I was fitted, the sweeps were held out."""

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from .. import published
from ..cell_results import CellResults, Studies, by_method
from ..elements import write_page_table
from ..page import Section
from ..statistics import mean_z, proportion_z, spread_z
from ..summary import TrialSummary, summarise_trials

FITTED = "fitted"
HELD_OUT = "held out"
AGREEMENT = 2.0  # standard errors within which two numbers count as agreeing
UNSAFE_RATE = 0.10  # the paper's baselines stay above this collision rate at every weight


class ComparedNumber(NamedTuple):
    """Holds one published number and ours."""

    kind: str  # `FITTED` or `HELD_OUT`
    label: str
    paper: str
    ours: str
    z: float  # the difference in standard errors
    is_range: bool = False  # whether the paper gives a range; then z = 0 within it


def reproduction_sections(studies: Studies, folder: Path) -> list[Section]:
    """Builds the section from Table I and both sweeps; returns none without results of them."""
    table_1 = studies.get("table_1", [])
    weights = studies.get("w_obs_sweep", [])
    numbers = compare_numbers(table_1, studies.get("theta_sweep", []), weights)
    if not numbers:
        return []

    tables = []
    for kind in (FITTED, HELD_OUT):
        frame = compared_frame(numbers, kind)
        if len(frame):
            stem = f"reproduction_{kind.replace(' ', '_')}"
            caption = f"{kind.capitalize().replace(' ', '-')} numbers, z in standard errors"
            tables.append(write_page_table(folder, stem, caption, frame))
    values = _open_values(table_1)
    if len(values):
        caption = "What the paper leaves open, with the calibrated values"
        tables.append(write_page_table(folder, "calibrated", caption, values))

    text = (
        "The paper leaves about ten numbers open. They were fitted to the costs, spreads and "
        "collision rates of Table I and to nothing else; both sweeps are predictions. z is the "
        "difference in standard errors; both sides are Monte Carlo estimates. Four choices were "
        "made by hand before the fit, so that the paper's qualitative picture appears: sigma_o is "
        "the standard deviation of a sample, the variance of Remark 4 is that of the obstacle "
        "penalty, a step is charged at its end, and the particle filter takes the measurement "
        "noise at the particles' mean."
    )
    sentences = [
        verdict(numbers, FITTED),
        verdict(numbers, HELD_OUT),
        *judged_claims(table_1, weights),
    ]
    return [Section("How well the published numbers are met", [text, *sentences], tables)]


def _open_values(cells: Sequence[CellResults]) -> pd.DataFrame:
    """Returns the calibrated settings of Table I's MPPI-Belief."""
    rows = []
    for cell in by_method(cells).get("belief", [])[:1]:
        for key, meaning in published.OPEN.items():
            value: Any = cell.config
            for name in key.split("."):
                value = value.get(name, {})
            rows.append(
                {"Key": key, "Meaning": meaning, "Value": "-" if value == {} else str(value)}
            )
    return pd.DataFrame(rows)


def compare_numbers(
    table_1: Sequence[CellResults], theta: Sequence[CellResults], weights: Sequence[CellResults]
) -> list[ComparedNumber]:
    """Compares every number that Table I, the theta sweep and the obstacle-weight sweep publish."""
    numbers: list[ComparedNumber] = []
    for cell in table_1:
        numbers.extend(_compare_table_1(cell, summarise_trials(cell.rows, None)))
    for cell in theta:
        numbers.extend(_compare_theta(cell, summarise_trials(cell.rows, None)))
    for cell in weights:
        numbers.extend(_compare_weight(cell, summarise_trials(cell.rows, None)))
    return numbers


def _compare_table_1(cell: CellResults, ours: TrialSummary) -> Iterator[ComparedNumber]:
    """Compares cost, spread and collisions of one cell with Table I."""
    paper = published.TABLE_1.get(cell.method)
    n = published.PAPER_TRIALS
    if paper is None or ours.good < 2:
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
    if paper is None or ours.good < 2:
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
    if ours.good < 2:
        return
    if cell.method in published.BASELINES:
        yield _compare_rate(HELD_OUT, label, ours, *published.BASELINE_RANGE)
    elif cell.method == "belief":
        bounds = [rate for start, rate in published.BELIEF_BELOW.items() if w_obs >= start]
        if bounds:
            yield _compare_rate(HELD_OUT, label, ours, 0.0, min(bounds))


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


def compared_frame(numbers: Sequence[ComparedNumber], kind: str) -> pd.DataFrame:
    """Returns the numbers of one kind as text."""
    chosen = [number for number in numbers if number.kind == kind]
    return pd.DataFrame(
        {
            "Number": [number.label for number in chosen],
            "Paper": [number.paper for number in chosen],
            "Here": [number.ours for number in chosen],
            "z": ["-" if math.isnan(number.z) else f"{number.z:+.1f}" for number in chosen],
        }
    )


def verdict(numbers: Sequence[ComparedNumber], kind: str) -> str:
    """Says how many numbers and ranges of one kind agree, and which one is farthest."""
    chosen = [number for number in numbers if number.kind == kind and math.isfinite(number.z)]
    name = kind.replace(" ", "-")
    if not chosen:
        return f"None of the {name} numbers has results yet."
    points = [number for number in chosen if not number.is_range]
    ranges = [number for number in chosen if number.is_range]
    agreeing = sum(abs(number.z) <= AGREEMENT for number in points)
    within = sum(abs(number.z) <= AGREEMENT for number in ranges)
    farthest = max(chosen, key=lambda number: abs(number.z))
    range_text = f", and {within} of {len(ranges)} ranges are met" if ranges else ""
    return (
        f"{agreeing} of the {len(points)} {name} numbers agree within {AGREEMENT:g} standard errors"
        f"{range_text}; the farthest is {farthest.label}: {farthest.ours} here, {farthest.paper} "
        f"in the paper (z = {farthest.z:+.1f})."
    )


def judged_claims(table_1: Sequence[CellResults], weights: Sequence[CellResults]) -> list[str]:
    """Judges the conclusions of the paper on our trials, a sentence each, and names exceptions."""
    sentences = [
        _safety_of_belief(cell) for cell in table_1 if cell.method == "belief" and len(cell.good)
    ]
    baselines = [
        cell
        for cell in (*table_1, *weights)
        if cell.method in published.BASELINES and len(cell.good)
    ]
    if baselines:
        claim = (
            f"Every baseline collides in more than {100 * UNSAFE_RATE:g} % of its trials at every "
            "obstacle weight"
        )
        sentences.append(_judge(claim, baselines, lambda rate: rate > UNSAFE_RATE))
        claim = "No baseline is free of collisions at any obstacle weight"
        sentences.append(_judge(claim, baselines, lambda rate: rate > 0))

    start = min(start for start, rate in published.BELIEF_BELOW.items() if rate > 0)
    heavy = [
        cell
        for cell in weights
        if cell.method == "belief" and cell.labels["w_obs"] >= start and len(cell.good)
    ]
    if heavy:
        claim = f"MPPI-Belief collides in less than 1 % of its trials from w_obs = {start:g} on"
        sentences.append(_judge(claim, heavy, lambda rate: rate < published.BELIEF_BELOW[start]))
    return sentences


def _safety_of_belief(cell: CellResults) -> str:
    """Compares the collisions of MPPI-Belief with the paper's none."""
    hits = int(cell.collided.sum())
    theta = cell.labels["theta"]
    ending = ", as published." if hits == 0 else "; the paper has none."
    return (
        f"MPPI-Belief at theta = {theta:g} has {hits} collisions in {len(cell.good)} trials{ending}"
    )


def _judge(claim: str, cells: Sequence[CellResults], holds: Callable[[float], bool]) -> str:
    """Says whether a claim on collision rates holds, and for which cells it fails."""
    failing: dict[str, None] = {}  # a cell that two studies share is named once
    for cell in cells:
        rate = float(cell.collided.mean())
        if not holds(rate):
            failing[f"{cell.name} at w_obs = {cell.labels['w_obs']:g} ({100 * rate:.1f} %)"] = None
    return f"{claim}: fails for {', '.join(failing)}." if failing else f"{claim}: holds."
