"""Where the Gaussian reduction is valid: Theorem 1's residual, NEES and NIS, and the loss against seeing the state."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from .. import figures
from ..cell_results import CellResults, paired_rows
from ..elements import collision_text, write_picture
from ..frame_files import write_frame
from ..page import Section, Table
from ..statistics import (
    NO_ESTIMATE,
    Estimate,
    chi_square_band,
    mean_interval,
    paired_mean_difference,
    proportion_interval,
)
from ..summary import interval_text

RARE = 1e-3  # of the trials of a consistent filter, at most, have a NEES as large as that of a lost one
FILTERS = {"ekf": "EKF", "ukf": "UKF", "particle": "Particles"}


class Point(NamedTuple):
    """One cell: a system, a filter, a curvature kappa, and what its trials show.

    residual    of Theorem 1, the mean over the steps of the recorded trial; nan without one
    nees, nis   by their degrees of freedom, so that 1 is right, means over trials with Student's interval
    bands       of both: 95 % of what a consistent filter shows lies within; see `bands`
    lost        part of the trials with a NEES that a consistent filter has in one of 1000 at most
    loss        of cost against the oracle of the system, trial by trial; nothing without one
    """

    found: CellResults
    system: str
    filter: str
    curvature: float
    residual: float
    nees: Estimate
    nis: Estimate
    bands: tuple[Estimate, Estimate]
    lost: Estimate
    loss: Estimate

    @property
    def consistent(self) -> bool:
        """Whether both means lie in their bands."""
        pairs = zip((self.nees, self.nis), self.bands, strict=True)
        return all(band.low <= one.value <= band.high for one, band in pairs)


def consistency(founds: list[CellResults], folder: Path) -> Section:
    """A table and a figure over the curvature, and for which curvatures a filter is what it says it is."""
    shown = points(founds)
    alt = "Theorem 1's residual, NEES and NIS with 95 % bands, and the loss against the oracle, over the curvature"
    frame, machine = as_frame(shown), pd.DataFrame([_numbers(point) for point in shown])
    write_frame(folder, "consistency", frame, machine)
    return Section(
        "Consistency: where the Gaussian reduction is valid",
        [
            "Measurements bend by `system.curvature`: at 0 they are affine, at 1 the sensor's own; what they tell at "
            "the anchor stays the same. Theorem 1's residual is the part of a measurement, in units of its noise, that "
            "is not tangent to the Gaussian means, averaged over a recorded trial. NEES and NIS are by their degrees "
            "of freedom: 1 is as sure as one may be. A filter counts as consistent here where both means lie in "
            "their 95 % chi-square bands: that of NEES as if a trial were one sample, its errors being correlated over "
            "time, that of NIS with every step, innovations being independent. Lost are trials whose NEES a consistent "
            "filter has in one of 1000 at most; a few of them make a mean of any size.",
            *verdicts(shown),
        ],
        [Table("consistency", "Every system, filter and curvature", frame)],
        write_picture(folder, "consistency", figures.consistency_figure(shown), alt),
    )


def points(founds: Sequence[CellResults]) -> list[Point]:
    """The cells that have a filter's controller and a curvature, by system, filter and curvature."""
    oracles = {
        _name(one, "system"): one for one in founds if one.method == "oracle" and len(one.good)
    }
    there = [one for one in founds if one.method != "oracle" and len(one.good)]
    made = [_point(one, oracles.get(_name(one, "system"))) for one in there]
    return sorted(made, key=lambda point: (point.system, point.filter, point.curvature))


def _point(found: CellResults, oracle: CellResults | None) -> Point:
    told: dict[str, Any] = (found.recording or {}).get("tangent", {})
    nx, ny = (float(told.get(name, math.nan)) for name in ("states", "measurements"))
    nees, nis = (mean_interval(found.good[name].to_numpy(float)) for name in ("nees", "nis"))
    beyond = found.good["nees"].to_numpy(float) > nx * chi_square_band(nx, 1 - 2 * RARE).high
    parts = [part for part in told.get("part", ()) if part is not None]
    return Point(
        found,
        _name(found, "system"),
        _name(found, "filter"),
        float(found.cell.config["system"].get("curvature", math.nan)),
        float(np.mean(parts)) if parts else math.nan,
        nees.times(1 / nx),
        nis.times(1 / ny),
        bands(nx, ny, len(found.good), int(found.good["steps"].max())),
        proportion_interval(int(beyond.sum()), len(beyond)) if nx > 0 else NO_ESTIMATE,
        NO_ESTIMATE if oracle is None else _loss(found, oracle),
    )


def bands(nx: float, ny: float, trials: int, steps: int) -> tuple[Estimate, Estimate]:
    """Where the means of NEES / nx and NIS / ny of a consistent filter lie in 95 %.

    Innovations are independent: ny degrees of freedom a step. Errors are not, so a trial counts as one sample of nx,
    which makes the band wider than it need be.
    """
    return chi_square_band(nx * trials), chi_square_band(ny * trials * steps)


def _loss(found: CellResults, oracle: CellResults) -> Estimate:
    one, other = paired_rows(found, oracle)
    return paired_mean_difference(one["cost"].to_numpy(), other["cost"].to_numpy())


def _name(found: CellResults, group: str) -> str:
    return str(found.cell.config["names"][group])


def verdicts(shown: Sequence[Point]) -> list[str]:
    """A sentence for each system and filter."""
    text = []
    for system, filter in dict.fromkeys((point.system, point.filter) for point in shown):
        cells = [point for point in shown if (point.system, point.filter) == (system, filter)]
        broken = [
            f"{point.curvature:g} (NEES {interval_text(point.nees, 2)})"
            for point in cells
            if not point.consistent
        ]
        told = f"not at curvature {', '.join(broken)}" if broken else "at every curvature"
        losses = ", ".join(
            f"{interval_text(point.loss, 2)} at {point.curvature:g}" for point in cells
        )
        text.append(
            f"{system}, {FILTERS.get(filter, filter)}: consistent {told}. Loss against the oracle: {losses}."
        )
    return text


def as_frame(shown: Sequence[Point]) -> pd.DataFrame:
    """A line of text a cell."""
    return pd.DataFrame(
        {
            "System": point.system,
            "Filter": FILTERS.get(point.filter, point.filter),
            "Curvature": f"{point.curvature:g}",
            "Residual": "-" if math.isnan(point.residual) else f"{point.residual:.4f}",
            "NEES/nx [95 %]": interval_text(point.nees, 3),
            "band": _span(point.bands[0]),
            "NIS/ny [95 %]": interval_text(point.nis, 3),
            "band ": _span(point.bands[1]),
            "Lost % [95 %]": interval_text(point.lost.times(100), 1),
            "Loss [95 %]": interval_text(point.loss, 2),
            "Collision %": collision_text(point.found),
        }
        for point in shown
    )


def _span(band: Estimate) -> str:
    return "-" if math.isnan(band.low) else f"{band.low:.3f} to {band.high:.3f}"


def _numbers(point: Point) -> dict[str, Any]:
    """The same for a machine."""
    line: dict[str, Any] = {
        name: getattr(point, name) for name in ("system", "filter", "curvature", "residual")
    }
    estimates = {"nees": point.nees, "nis": point.nis, "lost": point.lost, "loss": point.loss}
    estimates |= {"nees_band": point.bands[0], "nis_band": point.bands[1]}
    for name, value in estimates.items():
        line |= {name: value.value, f"{name}_low": value.low, f"{name}_high": value.high}
    return line | {"collided": float(point.found.collided.mean()), "trials": len(point.found.good)}
