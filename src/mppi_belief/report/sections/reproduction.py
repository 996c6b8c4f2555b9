"""How well each published number is met: Table I, which was fitted, and the sweeps, which were not."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from .. import published
from ..agreement import mean_z, proportion_z, spread_z
from ..cell_results import CellResults
from ..summary import TrialSummary, summarise_trials

FITTED, HELD_OUT = "fitted", "held out"
AGREES = 2.0  # standard errors
UNSAFE = 0.10  # the baselines stay above this at every weight


class Compared(NamedTuple):
    """One published number and ours: texts, and z, the difference in standard errors."""

    kind: str
    what: str
    paper: str
    ours: str
    z: float
    is_range: bool = False  # what the paper gives is a range, and z = 0 within


def compare(
    table_1: Sequence[CellResults], theta: Sequence[CellResults], weights: Sequence[CellResults]
) -> list[Compared]:
    """Every number that Table I, the theta sweep and the obstacle-weight sweep publish."""
    return [
        *(
            line
            for found in table_1
            for line in _table_1(found, summarise_trials(found.rows, None))
        ),
        *(line for found in theta for line in _theta(found, summarise_trials(found.rows, None))),
        *(line for found in weights for line in _weight(found, summarise_trials(found.rows, None))),
    ]


def _table_1(found: CellResults, ours: TrialSummary) -> Iterator[Compared]:
    paper, m = published.TABLE_1.get(found.method), published.TRIALS
    if paper is None or ours.good < 2:
        return
    z = mean_z(ours.cost.value, ours.sd, ours.good, paper.cost, paper.spread, m)
    yield Compared(FITTED, f"{found.name}, cost", f"{paper.cost}", f"{ours.cost.value:.1f}", z)
    z = spread_z(ours.sd, ours.good, paper.spread, m)
    yield Compared(
        FITTED, f"{found.name}, spread of the cost", f"{paper.spread}", f"{ours.sd:.1f}", z
    )
    yield _rate(
        FITTED, f"{found.name}, collisions %", ours, paper.collisions / m, paper.collisions / m
    )


def _theta(found: CellResults, ours: TrialSummary) -> Iterator[Compared]:
    theta, m = float(found.labels["theta"]), published.TRIALS
    paper = published.THETA.get(theta)
    if paper is None or ours.good < 2:
        return
    fitted = FITTED if theta == published.TABLE_1_THETA else HELD_OUT  # the same cell as in Table I
    yield _rate(fitted, f"theta {theta:g}, collisions %", ours, *paper.collision_rate)
    if paper.clearance is not None:  # its spread is not published: ours is taken for both
        values = found.good["clearance"].to_numpy(dtype=float)
        sd = float(np.std(values, ddof=1)) if np.all(np.isfinite(values)) else math.nan
        z = mean_z(ours.clearance.value, sd, ours.good, paper.clearance, sd, m)
        texts = f"{paper.clearance:.2f}", f"{ours.clearance.value:.2f}"
        yield Compared(HELD_OUT, f"theta {theta:g}, clearance m", *texts, z)
    if paper.cost is not None:
        z = mean_z(ours.cost.value, ours.sd, ours.good, paper.cost, ours.sd, m)
        yield Compared(
            fitted, f"theta {theta:g}, cost", f"{paper.cost}", f"{ours.cost.value:.1f}", z
        )


def _weight(found: CellResults, ours: TrialSummary) -> Iterator[Compared]:
    w_obs = float(found.labels["w_obs"])
    what = f"w_obs {w_obs:g}, {found.name}, collisions %"
    if ours.good < 2:
        return
    if found.method in published.BASELINES:
        yield _rate(HELD_OUT, what, ours, *published.BASELINE_RANGE)
    elif found.method == "belief":
        bounds = [rate for start, rate in published.BELIEF_BELOW.items() if w_obs >= start]
        if bounds:
            yield _rate(HELD_OUT, what, ours, 0.0, min(bounds))


def _rate(kind: str, what: str, ours: TrialSummary, low: float, high: float) -> Compared:
    """A collision rate against one the paper gives, or the nearest end of its range; z = 0 within."""
    rate, m = ours.collided.value, published.TRIALS
    nearest = min(max(rate, low), high)
    z = proportion_z(ours.collisions, ours.good, nearest * m, m)
    paper = f"{100 * low:.1f}" if low == high else f"{100 * low:g} to {100 * high:g}"
    return Compared(kind, what, paper, f"{100 * rate:.1f}", z, low != high)


def as_frame(lines: Sequence[Compared], kind: str) -> pd.DataFrame:
    """The lines of one kind as text."""
    chosen = [line for line in lines if line.kind == kind]
    return pd.DataFrame(
        {
            "Number": [line.what for line in chosen],
            "Paper": [line.paper for line in chosen],
            "Here": [line.ours for line in chosen],
            "z": ["-" if math.isnan(line.z) else f"{line.z:+.1f}" for line in chosen],
        }
    )


def verdict(lines: Sequence[Compared], kind: str) -> str:
    """One sentence: how many of the numbers of one kind agree, and of the ranges, and which is farthest."""
    chosen, name = (
        [line for line in lines if line.kind == kind and math.isfinite(line.z)],
        kind.replace(" ", "-"),
    )
    if not chosen:
        return f"None of the {name} numbers has results yet."
    worst = max(chosen, key=lambda line: abs(line.z))
    points, ranges = (
        [line for line in chosen if line.is_range == wanted] for wanted in (False, True)
    )
    met, within = (sum(abs(line.z) <= AGREES for line in part) for part in (points, ranges))
    also = f", and {within} of {len(ranges)} ranges are met as well" if ranges else ""
    return (
        f"{met} of the {len(points)} {name} numbers agree within {AGREES:g} standard errors{also}; "
        f"the farthest is {worst.what}: {worst.ours} here, {worst.paper} in the paper (z = {worst.z:+.1f})."
    )


def claims(table_1: Sequence[CellResults], weights: Sequence[CellResults]) -> list[str]:
    """What the paper concludes, judged on our trials: one sentence each, exceptions named."""
    found = [_is_safe(one) for one in table_1 if one.method == "belief" and len(one.good)]
    baselines = [
        one for one in (*table_1, *weights) if one.method in published.BASELINES and len(one.good)
    ]
    if baselines:
        text = f"Every baseline collides in more than {100 * UNSAFE:g} % of its trials at every obstacle weight"
        found.append(_but(text, baselines, lambda rate: rate > UNSAFE))
        found.append(
            _but(
                "No baseline is free of collisions at any obstacle weight",
                baselines,
                lambda rate: rate > 0,
            )
        )
    heavy = min(start for start, rate in published.BELIEF_BELOW.items() if rate > 0)
    belief = [
        one
        for one in weights
        if one.method == "belief" and one.labels["w_obs"] >= heavy and len(one.good)
    ]
    if belief:
        text = f"MPPI-Belief collides in less than 1 % of its trials from w_obs = {heavy:g} on"
        found.append(_but(text, belief, lambda rate: rate < published.BELIEF_BELOW[heavy]))
    return found


def _is_safe(one: CellResults) -> str:
    hits, n = int(one.collided.sum()), len(one.good)
    text = f"MPPI-Belief at theta = {one.labels['theta']:g} has {hits} collisions in {n} trials"
    return text + (", as published." if hits == 0 else "; the paper has none.")


def _but(text: str, founds: Sequence[CellResults], holds: Callable[[float], bool]) -> str:
    """The claim, and where it fails."""
    failing: dict[str, None] = {}  # a cell of two studies fails once
    for one in founds:
        hit = float(one.collided.mean())
        if not holds(hit):
            failing[f"{one.name} at w_obs = {one.labels['w_obs']:g} ({100 * hit:.1f} %)"] = None
    return f"{text}: fails for {', '.join(failing)}." if failing else f"{text}: holds."
