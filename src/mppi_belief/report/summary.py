"""Summarises the trials of a cell as numbers and as one line of text."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from .statistics import Estimate, mean_interval, proportion_interval

BUSY_MARK = "*"
BUSY_NOTE = (
    f"{BUSY_MARK} timed while other work kept the machine busy; `mppi-belief run` measures it again"
)


class TrialSummary(NamedTuple):
    """Holds what the trials of a cell show; averages leave out the trials that failed."""

    trials: int  # with the failed ones
    failed: int
    cost: Estimate  # mean
    sd: float  # standard deviation of the cost over trials
    collisions: int  # trials that collide
    collided: Estimate  # part of the good trials that collides
    clearance: Estimate  # mean, m
    ess: float  # mean effective sample size
    time: float  # median of a control step, ms
    time_p95: float  # 95th percentile of a control step, ms

    @property
    def good(self) -> int:
        """Returns the number of trials that did not fail."""
        return self.trials - self.failed


def summarise_trials(rows: pd.DataFrame, seconds: Sequence[float] | None) -> TrialSummary:
    """Summarises rows of trials and wall times (s) of single control steps."""
    good = rows[rows["status"] == "ok"]
    collisions = int(good["collided"].astype(bool).sum())
    return TrialSummary(
        trials=len(rows),
        failed=len(rows) - len(good),
        cost=mean_interval(good["cost"].to_numpy()),
        sd=float(np.std(good["cost"], ddof=1)) if len(good) > 1 else math.nan,
        collisions=collisions,
        collided=proportion_interval(collisions, len(good)),
        clearance=mean_interval(good["clearance"].to_numpy()),
        ess=float(good["ess"].mean()) if len(good) else math.nan,
        time=1e3 * float(np.median(seconds)) if seconds else math.nan,
        time_p95=1e3 * float(np.quantile(seconds, 0.95)) if seconds else math.nan,
    )


def summary_text(
    rows: pd.DataFrame,
    labels: dict[str, Any],
    seconds: Sequence[float] | None,
    busy: bool = False,
) -> dict[str, str]:
    """Returns the labels and the summary of a cell as the columns of one line of text.

    Times that were measured on a busy machine are marked; `BUSY_NOTE` explains the mark.
    """
    summary = summarise_trials(rows, seconds)
    trials = str(summary.trials)
    line = {name: label_text(value) for name, value in labels.items()}
    line["trials"] = f"{trials} ({summary.failed} failed)" if summary.failed else trials
    line["cost [95 %]"] = interval_text(summary.cost, 2)
    line["sd"] = f"{summary.sd:.2f}" if math.isfinite(summary.sd) else "-"
    line["collided % [95 %]"] = interval_text(summary.collided.times(100), 1)
    line["clearance m [95 %]"] = interval_text(summary.clearance, 3)
    line["ESS"] = "-" if math.isnan(summary.ess) else f"{summary.ess:.1f}"
    if seconds:
        line["ms/step (p95)"] = time_text(summary, busy)
    return line


def time_text(summary: TrialSummary, busy: bool) -> str:
    """Returns median and 95th percentile of a control step in ms, with a mark if busy."""
    mark = BUSY_MARK if busy else ""
    return f"{summary.time:.2f} ({summary.time_p95:.2f}){mark}"


def summary_numbers(
    rows: pd.DataFrame, labels: dict[str, Any], seconds: Sequence[float] | None
) -> dict[str, Any]:
    """Returns the labels and the summary of a cell in full precision.

    An estimate takes three columns: NAME, NAME_low, NAME_high.
    """
    line = dict(labels)
    for name, value in summarise_trials(rows, seconds)._asdict().items():
        line |= estimate_columns(name, value) if isinstance(value, Estimate) else {name: value}
    return line


def estimate_columns(name: str, estimate: Estimate) -> dict[str, float]:
    """Returns an estimate as the three columns NAME, NAME_low, NAME_high."""
    return {name: estimate.value, f"{name}_low": estimate.low, f"{name}_high": estimate.high}


def interval_text(estimate: Estimate, digits: int) -> str:
    """Returns "value [low, high]", "value" without an interval, or "-" without a value."""
    if not np.isfinite(estimate.value):
        return "-"
    value, low, high = (f"{part:.{digits}f}" for part in estimate)
    return f"{value} [{low}, {high}]" if np.isfinite(estimate.low) else value


def label_text(value: Any) -> str:
    """Returns the text of a label: a number in short, "-" where a method has no such setting."""
    if isinstance(value, float):
        return "-" if np.isnan(value) else f"{value:g}"
    return str(value)


def aligned_text(lines: Sequence[dict[str, str]]) -> str:
    """Returns the lines as a table with aligned columns."""
    return str(pd.DataFrame(list(lines)).fillna("-").to_string(index=False))
