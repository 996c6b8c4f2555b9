"""Judges statements on collision rates, and says on which cells they were tested.

A claim on "every" cell holds only once every one of these cells has as many trials as in the paper.
Until then it waits, and names what it needs. The rates are those observed, as in the paper; their
intervals stand in the tables.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from ..errors import counted
from . import published
from .cell_results import METHOD_NAMES, CellResults
from .wording import count_range, listed

UNSAFE_RATE = 0.10  # the paper's baselines stay above this collision rate at every weight


class Claim(NamedTuple):
    """Holds a statement about the collision rates of some methods at some obstacle weights."""

    text: str
    methods: tuple[str, ...]  # options of `controller`
    weights: tuple[float, ...]  # of the sweep of Fig. 2
    holds: Callable[[float], bool]  # whether a rate agrees with the statement


class Judgement(NamedTuple):
    """Holds on which cells a claim was tested, and where it fails."""

    tested: list[CellResults]  # cells with as many finished trials as the paper
    failing: list[CellResults]  # those of them whose rate contradicts the claim
    needed: dict[str, list[float]]  # by name of the method, the weights without such a cell


def paper_claims() -> list[Claim]:
    """Returns the conclusions that the paper draws from Fig. 2."""
    every = published.FIG_2_WEIGHTS
    return [
        Claim(
            f"Every baseline collides in more than {100 * UNSAFE_RATE:g} % of its trials at every "
            "obstacle weight",
            published.BASELINES,
            every,
            lambda rate: rate > UNSAFE_RATE,
        ),
        Claim(
            "No baseline is free of collisions at any obstacle weight",
            published.BASELINES,
            every,
            lambda rate: rate > 0,
        ),
        belief_below_claim(),
    ]


def belief_below_claim() -> Claim:
    """Returns the claim that MPPI-Belief hardly collides from some obstacle weight on."""
    start = min(start for start, rate in published.BELIEF_BELOW.items() if rate > 0)
    below = published.BELIEF_BELOW[start]
    return Claim(
        f"MPPI-Belief collides in less than {100 * below:g} % of its trials from "
        f"w_obs = {start:g} on",
        ("belief",),
        tuple(weight for weight in published.FIG_2_WEIGHTS if weight >= start),
        lambda rate: rate < below,
    )


def belief_free_claim() -> Claim:
    """Returns the claim that MPPI-Belief never collides from some obstacle weight on."""
    start = min(start for start, rate in published.BELIEF_BELOW.items() if rate == 0)
    return Claim(
        f"MPPI-Belief collides in no trial from w_obs = {start:g} on",
        ("belief",),
        tuple(weight for weight in published.FIG_2_WEIGHTS if weight >= start),
        lambda rate: rate == 0,
    )


def baseline_range_claim() -> Claim:
    """Returns the claim that every baseline keeps to the paper's range of collision rates."""
    low, high = published.BASELINE_RANGE
    return Claim(
        f"Every baseline collides in {100 * low:g} to {100 * high:g} % of its trials at every "
        "obstacle weight",
        published.BASELINES,
        published.FIG_2_WEIGHTS,
        lambda rate: low <= rate <= high,
    )


def judged_claims(table_1: Sequence[CellResults], weights: Sequence[CellResults]) -> list[str]:
    """Judges the conclusions of the paper on our trials, a sentence each.

    `table_1` and `weights` are the cells of Table I and of Fig. 2. Cells with other settings than
    the paper's do not count. Returns no sentence where there are no trials at all.
    """
    table_1 = [cell for cell in table_1 if cell.has_paper_settings() and len(cell.good)]
    weights = [
        cell for cell in weights if cell.has_paper_settings(published.WEIGHT_KEY) and len(cell.good)
    ]
    sentences = [_safety_of_belief(cell) for cell in table_1 if cell.method == "belief"]
    if table_1 or weights:
        sentences += [judged(claim, weights) for claim in paper_claims()]
    return sentences


def judge(claim: Claim, cells: Sequence[CellResults]) -> Judgement:
    """Tests a claim on every cell that it speaks of and that has as many trials as the paper."""
    tested: list[CellResults] = []
    needed: dict[str, list[float]] = {}
    for method in claim.methods:
        for weight in claim.weights:
            cell = _tested_cell(cells, method, weight)
            if cell is None:
                needed.setdefault(METHOD_NAMES[method], []).append(weight)
            else:
                tested.append(cell)
    failing = [cell for cell in tested if not claim.holds(float(cell.collided.mean()))]
    return Judgement(tested, failing, needed)


def judged(claim: Claim, cells: Sequence[CellResults]) -> str:
    """Says whether a claim holds, for which cells it fails, or what it needs to be tested."""
    tested, failing, needed = judge(claim, cells)
    if failing:
        verdict = f"fails for {listed([_rate_text(cell) for cell in failing])}"
        verdict += f"; tested on {_tested_text(tested)}"
        return f"{claim.text}: {verdict}{_still_needed(needed, '; not tested: ')}."
    if needed:
        return f"{claim.text}: not tested{_still_needed(needed, ': needs ')}."
    return f"{claim.text}: holds for the rates observed, tested on {_tested_text(tested)}."


def _tested_cell(cells: Sequence[CellResults], method: str, weight: float) -> CellResults | None:
    """Returns the cell of a method at a weight if it has as many finished trials as the paper."""
    for cell in cells:
        if cell.method == method and cell.labels["w_obs"] == weight:
            return cell if len(cell.rows) >= published.PAPER_TRIALS else None
    return None


def _rate_text(cell: CellResults) -> str:
    rate = 100 * float(cell.collided.mean())
    return f"{cell.name} at w_obs = {cell.labels['w_obs']:g} ({rate:.1f} %)"


def _tested_text(cells: Sequence[CellResults]) -> str:
    """Returns what was tested: methods, weights, number of trials."""
    names = list(dict.fromkeys(cell.name for cell in cells))
    weights = sorted({cell.labels["w_obs"] for cell in cells})
    trials = count_range(len(cell.good) for cell in cells)
    return (
        f"{counted(len(cells), 'cell')} ({listed(names)}; "
        f"w_obs = {', '.join(f'{weight:g}' for weight in weights)}) with {trials} trials each"
    )


def _still_needed(needed: dict[str, list[float]], prefix: str) -> str:
    """Returns the cells that a claim lacks, after a prefix; nothing where it lacks none."""
    if not needed:
        return ""
    names_by_weights: dict[str, list[str]] = {}
    for name, weights in needed.items():
        text = ", ".join(f"{weight:g}" for weight in weights)
        names_by_weights.setdefault(text, []).append(name)
    texts = [f"{listed(names)} at w_obs = {text}" for text, names in names_by_weights.items()]
    return f"{prefix}{published.PAPER_TRIALS} trials of {'; '.join(texts)}"


def _safety_of_belief(cell: CellResults) -> str:
    """Counts the collisions of MPPI-Belief beside the paper's."""
    hits = int(cell.collided.sum())
    theta = cell.labels["theta"]
    paper = published.TABLE_1["belief"].collisions
    return (
        f"MPPI-Belief at theta = {theta:g} has {counted(hits, 'collision')} in "
        f"{counted(len(cell.good), 'trial')}; the paper has {paper} in {published.PAPER_TRIALS}."
    )
