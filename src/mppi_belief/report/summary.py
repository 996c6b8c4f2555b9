"""One line a cell: what its trials show, for a terminal."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from .statistics import Estimate, mean_interval, proportion_interval


def summarise(rows: pd.DataFrame, labels: dict[str, Any], seconds: Sequence[float] | None) -> dict[str, str]:
    """The columns of one line, as text. Trials that failed are counted and left out of every average."""
    good = rows[rows["status"] == "ok"]
    cost, clearance = mean_interval(good["cost"].to_numpy()), mean_interval(good["clearance"].to_numpy())
    collided = proportion_interval(int(good["collided"].astype(bool).sum()), len(good))
    spread = float(np.std(good["cost"], ddof=1)) if len(good) > 1 else float("nan")
    line = {name: _plain(value) for name, value in labels.items()}
    line["trials"] = str(len(rows)) if len(good) == len(rows) else f"{len(rows)} ({len(rows) - len(good)} failed)"
    line["cost [95 %]"] = _interval(cost, 2)
    line["sd"] = f"{spread:.2f}"
    line["collided % [95 %]"] = _interval(Estimate(*(100 * part for part in collided)), 1)
    line["clearance m [95 %]"] = _interval(clearance, 3)
    line["ESS"] = _interval(Estimate(float(good["ess"].mean()), math.nan, math.nan), 1)
    if seconds:
        line["ms/step (p95)"] = f"{1e3 * np.median(seconds):.2f} ({1e3 * np.quantile(seconds, 0.95):.2f})"
    return line


def _interval(estimate: Estimate, digits: int) -> str:
    if not np.isfinite(estimate.value):
        return "-"
    value, low, high = (f"{part:.{digits}f}" for part in estimate)
    return f"{value} [{low}, {high}]" if np.isfinite(estimate.low) else value


def _plain(value: Any) -> str:
    if isinstance(value, float):
        return "-" if np.isnan(value) else f"{value:g}"
    return str(value)


def as_text(lines: Sequence[dict[str, str]]) -> str:
    """The lines as a table with aligned columns."""
    return str(pd.DataFrame(list(lines)).fillna("-").to_string(index=False))
