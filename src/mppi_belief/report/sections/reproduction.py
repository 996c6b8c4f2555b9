"""Reports how well each published number is met: Table I was fitted, the sweeps were held out."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from ...errors import counted
from .. import published
from ..agreement import FITTED, HELD_OUT, ComparedNumber, compare_numbers
from ..cell_results import CellResults, Studies, by_method
from ..elements import write_page_table
from ..page import Section

AGREEMENT = 2.0  # standard errors within which two numbers count as agreeing
UNSAFE_RATE = 0.10  # the paper's baselines stay above this collision rate at every weight


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
    share = f"{counted(hits, 'collision')} in {counted(len(cell.good), 'trial')}"
    return f"MPPI-Belief at theta = {theta:g} has {share}{ending}"


def _judge(claim: str, cells: Sequence[CellResults], holds: Callable[[float], bool]) -> str:
    """Says whether a claim on collision rates holds, and for which cells it fails."""
    failing: dict[str, None] = {}  # a cell that two studies share is named once
    for cell in cells:
        rate = float(cell.collided.mean())
        if not holds(rate):
            failing[f"{cell.name} at w_obs = {cell.labels['w_obs']:g} ({100 * rate:.1f} %)"] = None
    return f"{claim}: fails for {', '.join(failing)}." if failing else f"{claim}: holds."
