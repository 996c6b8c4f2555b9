"""One line a cell: what its trials show, as numbers and as text."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from .statistics import Estimate, mean_interval, proportion_interval


class TrialSummary(NamedTuple):
    """Trials that failed are counted and left out of every average. Clearance in m, times in ms per control step."""

    trials: int
    failed: int
    cost: Estimate
    sd: float
    collisions: int
    collided: Estimate
    clearance: Estimate
    ess: float
    time: float
    time_p95: float

    @property
    def good(self) -> int:
        return self.trials - self.failed


def summarise_trials(rows: pd.DataFrame, seconds: Sequence[float] | None) -> TrialSummary:
    """What rows of trials and wall times (s) of control steps show."""
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
    rows: pd.DataFrame, labels: dict[str, Any], seconds: Sequence[float] | None
) -> dict[str, str]:
    """The columns of one line, as text."""
    found = summarise_trials(rows, seconds)
    line = {name: label_text(value) for name, value in labels.items()}
    line["trials"] = (
        f"{found.trials} ({found.failed} failed)" if found.failed else str(found.trials)
    )
    line["cost [95 %]"] = interval_text(found.cost, 2)
    line["sd"] = f"{found.sd:.2f}"
    line["collided % [95 %]"] = interval_text(found.collided.times(100), 1)
    line["clearance m [95 %]"] = interval_text(found.clearance, 3)
    line["ESS"] = "-" if math.isnan(found.ess) else f"{found.ess:.1f}"
    if seconds:
        line["ms/step (p95)"] = f"{found.time:.2f} ({found.time_p95:.2f})"
    return line


def summary_numbers(
    rows: pd.DataFrame, labels: dict[str, Any], seconds: Sequence[float] | None
) -> dict[str, Any]:
    """The same for a machine: an estimate is three columns, NAME, NAME_low, NAME_high."""
    line = dict(labels)
    for name, value in summarise_trials(rows, seconds)._asdict().items():
        if isinstance(value, Estimate):
            line |= {name: value.value, f"{name}_low": value.low, f"{name}_high": value.high}
        else:
            line[name] = value
    return line


def interval_text(estimate: Estimate, digits: int) -> str:
    """ "value [low, high]", the value alone where there is no interval, "-" where there is no value."""
    if not np.isfinite(estimate.value):
        return "-"
    value, low, high = (f"{part:.{digits}f}" for part in estimate)
    return f"{value} [{low}, {high}]" if np.isfinite(estimate.low) else value


def label_text(value: Any) -> str:
    """A label: numbers in short, "-" where a method has no such setting."""
    if isinstance(value, float):
        return "-" if np.isnan(value) else f"{value:g}"
    return str(value)


def aligned_text(lines: Sequence[dict[str, str]]) -> str:
    """The lines as a table with aligned columns."""
    return str(pd.DataFrame(list(lines)).fillna("-").to_string(index=False))
