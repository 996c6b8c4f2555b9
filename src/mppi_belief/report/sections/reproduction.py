"""Reports how well each published number is met, in three groups: chosen, fitted, held out."""

import math
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from ...errors import counted
from ..agreement import AGREEMENT, FITTED, HELD_OUT, ComparedNumber, compare_numbers
from ..cell_results import Studies
from ..claims import judged_claims
from ..elements import write_page_table
from ..open_settings import chosen_frame, fitted_frame
from ..page import Section
from ..statistics import two_sided_p
from ..targets import evaluate_targets, targets_frame
from ..wording import listed

FAMILY_LEVEL = 0.05  # probability of an adjusted p-value below it among equal numbers
THREE_GROUPS = (
    "What stands beside the paper's numbers falls into three groups. The structure was chosen: "
    "the shape of the penalty, the rules for its moments and the reading of the start with a look "
    "at the sweeps, the rest by hand. The numbers of this structure were fitted to the costs, "
    "spreads and collision rates of Table I and to nothing else. The sweeps are held out: from the "
    "fit of the numbers, but not from the choice of the structure. z is the difference in standard "
    "errors; both sides are Monte Carlo estimates. Starting values of the fit came from a search "
    "that looked at two numbers of the theta sweep, too: the clearances at theta = 0 and 1."
)


def reproduction_sections(studies: Studies, folder: Path) -> list[Section]:
    """Builds the section from Table I and both sweeps; returns none without results of them."""
    table_1 = studies.get("table_1", [])
    weights = studies.get("w_obs_sweep", [])
    numbers = compare_numbers(table_1, studies.get("theta_sweep", []), weights)
    if not numbers:
        return []

    # What was chosen, what was fitted, and the targets.
    ours = [cell for cell in table_1 if cell.has_paper_settings()]
    tables = [
        write_page_table(folder, stem, caption, frame)
        for stem, caption, frame in (
            ("targets", "Targets", targets_frame(evaluate_targets(studies))),
            ("chosen", "Chosen: the structure", chosen_frame(ours)),
            ("calibrated", "Fitted: the numbers that the paper leaves open", fitted_frame(ours)),
        )
        if len(frame)
    ]

    # The published numbers.
    for kind in (FITTED, HELD_OUT):
        frame = compared_frame(numbers, kind)
        if len(frame):
            stem = f"reproduction_{kind.replace(' ', '_')}"
            caption = (
                f"{kind.capitalize().replace(' ', '-')} numbers, z in standard errors; p is "
                f"adjusted by Holm's method for all {counted(len(numbers), 'comparison')}"
            )
            tables.append(write_page_table(folder, stem, caption, frame))

    sentences = [
        verdict(numbers, FITTED),
        verdict(numbers, HELD_OUT),
        multiplicity_verdict(numbers),
        *judged_claims(table_1, weights),
    ]
    title = "How well the published numbers are met"
    return [Section(title, [THREE_GROUPS, *sentences], tables)]


def compared_frame(numbers: Sequence[ComparedNumber], kind: str) -> pd.DataFrame:
    """Returns the numbers of one kind as text."""
    chosen = [number for number in numbers if number.kind == kind]
    return pd.DataFrame(
        {
            "Number": [number.label for number in chosen],
            "Paper": [number.paper for number in chosen],
            "Here": [number.ours for number in chosen],
            "z": ["-" if math.isnan(number.z) else f"{number.z:+.1f}" for number in chosen],
            "p (Holm)": ["-" if math.isnan(number.p) else f"{number.p:.2g}" for number in chosen],
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
    range_text = f", and {within} of {counted(len(ranges), 'range')} met" if ranges else ""
    number_text = counted(len(points), f"{name} number")
    verb = "agrees" if agreeing == 1 else "agree"
    return (
        f"{agreeing} of the {number_text} {verb} within {AGREEMENT:g} standard errors"
        f"{range_text}; the farthest is {farthest.label}: {farthest.ours} here, {farthest.paper} "
        f"in the paper (z = {farthest.z:+.1f})."
    )


def multiplicity_verdict(numbers: Sequence[ComparedNumber]) -> str:
    """Says what so many comparisons at once mean, and which numbers differ in spite of it."""
    finite = [number for number in numbers if math.isfinite(number.z)]
    beyond = sum(abs(number.z) > AGREEMENT for number in finite)
    expected = len(finite) * two_sided_p(AGREEMENT)
    different = [
        f"{number.label} (p = {number.p:.2g})" for number in finite if number.p < FAMILY_LEVEL
    ]
    text = (
        f"Of {counted(len(finite), 'comparison')} {beyond} lie beyond {AGREEMENT:g} standard "
        f"errors; at most {expected:.1f} would by chance if every number were equal to the "
        f"paper's. With Holm's correction at {100 * FAMILY_LEVEL:g} % for all comparisons together "
    )
    if not different:
        return f"{text}no number differs."
    return f"{text}{counted(len(different), 'number')} differ: {listed(different)}."
