"""Reports where the Gaussian reduction holds: the residual of Theorem 1, NEES, NIS, the loss."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..cell_results import CellResults
from ..comparison import cost_difference
from ..elements import collision_text, write_picture
from ..figures.filter_consistency import ConsistencyPoint, consistency_figure
from ..frame_files import write_frame
from ..page import PageTable, Section
from ..statistics import (
    NO_ESTIMATE,
    Estimate,
    chi_square_band,
    mean_interval,
    proportion_interval,
)
from ..summary import estimate_columns, interval_text

LOST_PROBABILITY = 1e-3  # a lost trial has a NEES that a consistent filter exceeds no more often
FILTER_NAMES = {"ekf": "EKF", "ukf": "UKF", "particle": "Particles"}


def nonlinearity_section(cells: list[CellResults], folder: Path) -> Section:
    """Builds the section: a table and a figure over the curvature, a verdict for each filter."""
    points = consistency_points(cells)
    alt = (
        "Theorem 1's residual, NEES and NIS with 95 % bands, and the loss against the oracle, over "
        "the curvature"
    )
    frame = consistency_frame(points)
    numbers = pd.DataFrame([_consistency_numbers(point) for point in points])
    write_frame(folder, "consistency", frame, numbers)
    return Section(
        "Consistency: where the Gaussian reduction is valid",
        [
            "`system.curvature` sets how nonlinear the measurements are: affine at 0, those of the "
            "sensor itself at 1. Their information at the anchor point stays the same. Theorem 1's "
            "residual is the part of a measurement, in units of its noise, that is not tangent to "
            "the manifold of Gaussian means, averaged over a recorded trial.",
            "NEES and NIS are divided by their degrees of freedom, so that a consistent filter has "
            "1. A filter counts as consistent here if both means lie in their 95 % chi-square "
            "bands. The band of NEES counts a trial as one sample, since the errors of a trial are "
            "correlated over time; that of NIS counts every step, since innovations are "
            "independent. A lost trial has a NEES that at most one of 1000 trials of a consistent "
            "filter has; a few lost trials dominate a mean.",
            *verdicts(points),
        ],
        [PageTable("consistency", "Every system, filter and curvature", frame)],
        write_picture(folder, "consistency", lambda: consistency_figure(points), alt),
    )


def consistency_points(cells: Sequence[CellResults]) -> list[ConsistencyPoint]:
    """Evaluates every cell that does not see the state, sorted by system, filter and curvature."""
    oracles = {cell.system: cell for cell in cells if cell.method == "oracle" and len(cell.good)}
    points = [
        _evaluate(cell, oracles.get(cell.system))
        for cell in cells
        if cell.method != "oracle" and len(cell.good)
    ]
    return sorted(points, key=lambda point: (point.system, point.filter, point.curvature))


def _evaluate(cell: CellResults, oracle: CellResults | None) -> ConsistencyPoint:
    """Evaluates one cell against the oracle of its system."""
    tangent: dict[str, Any] = (cell.recording or {}).get("tangent", {})
    nx = float(tangent.get("states", math.nan))
    ny = float(tangent.get("measurements", math.nan))
    residuals = [value for value in tangent.get("part", ()) if value is not None]

    # The part of the trials that are lost.
    nees = cell.good["nees"].to_numpy(float)
    lost_above = nx * chi_square_band(nx, 1 - 2 * LOST_PROBABILITY).high
    lost_part = proportion_interval(int((nees > lost_above).sum()), len(nees))

    trials = len(cell.good)
    steps = int(cell.good["steps"].max())
    nees_band, nis_band = consistency_bands(nx, ny, trials, steps)
    return ConsistencyPoint(
        system=cell.system,
        filter=str(cell.config["names"]["filter"]),
        curvature=float(cell.config["system"].get("curvature", math.nan)),
        residual=float(np.mean(residuals)) if residuals else math.nan,
        nees=mean_interval(nees).times(1 / nx),
        nis=mean_interval(cell.good["nis"].to_numpy(float)).times(1 / ny),
        nees_band=nees_band,
        nis_band=nis_band,
        lost=lost_part if nx > 0 else NO_ESTIMATE,
        loss=NO_ESTIMATE if oracle is None else cost_difference(cell, oracle),
        collisions=collision_text(cell),
        collided=float(cell.collided.mean()),
        trials=trials,
    )


def consistency_bands(nx: float, ny: float, trials: int, steps: int) -> tuple[Estimate, Estimate]:
    """Returns the 95 % bands of the means of NEES / nx and NIS / ny of a consistent filter.

    Innovations are independent, so a step has ny degrees of freedom. Errors are correlated, so a
    trial counts as one sample of nx, which makes the band wider than necessary.
    """
    return chi_square_band(nx * trials), chi_square_band(ny * trials * steps)


def verdicts(points: Sequence[ConsistencyPoint]) -> list[str]:
    """Returns a sentence for each system and filter."""
    sentences = []
    for system, filter_name in dict.fromkeys((point.system, point.filter) for point in points):
        curve = [point for point in points if (point.system, point.filter) == (system, filter_name)]
        inconsistent = [
            f"{point.curvature:g} (NEES {interval_text(point.nees, 2)})"
            for point in curve
            if not point.consistent
        ]
        verdict = "consistent at every curvature"
        if inconsistent:
            verdict = f"not consistent at curvature {', '.join(inconsistent)}"
        losses = [f"{interval_text(point.loss, 2)} at {point.curvature:g}" for point in curve]
        name = FILTER_NAMES.get(filter_name, filter_name)
        sentences.append(
            f"{name} on {system}: {verdict}. Loss against the oracle: {', '.join(losses)}."
        )
    return sentences


def consistency_frame(points: Sequence[ConsistencyPoint]) -> pd.DataFrame:
    """Returns a line of text per cell."""
    return pd.DataFrame(
        {
            "System": point.system,
            "Filter": FILTER_NAMES.get(point.filter, point.filter),
            "Curvature": f"{point.curvature:g}",
            "Residual": "-" if math.isnan(point.residual) else f"{point.residual:.4f}",
            "NEES/nx [95 %]": interval_text(point.nees, 3),
            "NEES band": _band_text(point.nees_band),
            "NIS/ny [95 %]": interval_text(point.nis, 3),
            "NIS band": _band_text(point.nis_band),
            "Lost % [95 %]": interval_text(point.lost.times(100), 1),
            "Loss [95 %]": interval_text(point.loss, 2),
            "Collision %": point.collisions,
        }
        for point in points
    )


def _band_text(band: Estimate) -> str:
    return "-" if math.isnan(band.low) else f"{band.low:.3f} to {band.high:.3f}"


def _consistency_numbers(point: ConsistencyPoint) -> dict[str, Any]:
    """Returns the line of one cell in full precision."""
    return {
        "system": point.system,
        "filter": point.filter,
        "curvature": point.curvature,
        "residual": point.residual,
        **estimate_columns("nees", point.nees),
        **estimate_columns("nis", point.nis),
        **estimate_columns("lost", point.lost),
        **estimate_columns("loss", point.loss),
        **estimate_columns("nees_band", point.nees_band),
        **estimate_columns("nis_band", point.nis_band),
        "collided": point.collided,
        "trials": point.trials,
    }
