"""Draws the consistency of the filters over the curvature of the measurements, by system."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..statistics import Estimate
from .points import draw_estimates
from .style import BLUE, COLUMN, GREEN, GREY, OTHER, STYLE, Look, drawing_style

FILTER_LOOKS = {"ekf": Look(BLUE, "o", "-"), "ukf": Look(GREEN, "^", "-.")}
LOGARITHMIC_ABOVE = 3.0  # a NEES by its degrees of freedom from which an axis is logarithmic
DODGE = 0.02  # of curvature, by which the lines of two filters are moved apart
NIS_STYLE: Any = {"mfc": "none", "ls": ":"}
BAND_SHADES = {"NEES": "#DDDDDD", "NIS": "#AAAAAA"}  # the band of NIS is narrower, so it is darker


class ConsistencyPoint(NamedTuple):
    """Holds what the trials of one cell show: a system, a filter, a curvature kappa."""

    system: str
    filter: str
    curvature: float  # kappa: 0 affine measurements, 1 those of the sensor itself
    residual: float  # of Theorem 1, mean over the steps of the recorded trial; NaN without one
    nees: Estimate  # mean over trials, divided by nx; a consistent filter has 1
    nis: Estimate  # mean over trials, divided by ny; a consistent filter has 1
    nees_band: Estimate  # holds 95 % of the values of a consistent filter
    nis_band: Estimate  # holds 95 % of the values of a consistent filter
    lost: Estimate  # part of the trials whose NEES a consistent filter hardly ever has
    loss: Estimate  # of cost against the oracle of the system, trial by trial; NaN without one
    collisions: str  # collision rate with its interval, as text
    collided: float  # collision rate
    trials: int  # good ones

    @property
    def consistent(self) -> bool:
        """Tells whether both means lie in their bands."""
        return _lies_in(self.nees, self.nees_band) and _lies_in(self.nis, self.nis_band)


def _lies_in(estimate: Estimate, band: Estimate) -> bool:
    return band.low <= estimate.value <= band.high


def consistency_figure(points: Sequence[ConsistencyPoint]) -> Figure | None:
    """Draws three panels per system against the curvature, one line per filter.

    Top: Theorem 1's residual. Middle: NEES and NIS divided by their degrees of freedom, with the 95
    % bands of a consistent filter. Bottom: the loss of cost against the oracle. None without
    points.
    """
    systems = list(dict.fromkeys(point.system for point in points))
    if not systems:
        return None
    with drawing_style(STYLE):
        figure = Figure(figsize=(COLUMN * max(len(systems), 1.3), 5.2), layout="constrained")
        panels = figure.subplots(3, len(systems), sharex="col", squeeze=False)
        for column, system in zip(panels.T, systems, strict=True):
            _draw_system(column, [point for point in points if point.system == system])

        names = ("Theorem 1's residual", "by degrees of freedom", "loss to the oracle")
        for axes, name in zip(panels[:, 0], names, strict=True):
            axes.set_ylabel(name)
        handles, labels = panels[1, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=6)
        return figure


def _draw_system(column: np.ndarray, points: Sequence[ConsistencyPoint]) -> None:
    """Draws the three panels (3,) of one system."""
    column[0].set_title(points[0].system)
    _draw_bands(column[1], points)
    for index, filter_name in enumerate(dict.fromkeys(point.filter for point in points)):
        curve = [point for point in points if point.filter == filter_name]
        _draw_filter(column, curve, DODGE * (2 * index - 1))
    if max(point.nees.value for point in points) > LOGARITHMIC_ABOVE:
        column[1].set_yscale("log")
        column[1].yaxis.set_major_formatter("{x:g}")
    column[2].axhline(0, color=GREY, lw=0.6)
    column[2].set_xlabel(r"curvature $\kappa$")


def _draw_bands(axes: Axes, points: Sequence[ConsistencyPoint]) -> None:
    """Shades the bands of a consistent filter."""
    curvatures = sorted({point.curvature for point in points})
    bands = {
        "NEES": {point.curvature: point.nees_band for point in points},
        "NIS": {point.curvature: point.nis_band for point in points},
    }
    for name, band in bands.items():
        low = [band[curvature].low for curvature in curvatures]
        high = [band[curvature].high for curvature in curvatures]
        label = f"95 % band of {name}"
        axes.fill_between(
            curvatures, low, high, color=BAND_SHADES[name], lw=0, zorder=0, label=label
        )


def _draw_filter(column: np.ndarray, curve: Sequence[ConsistencyPoint], shift: float) -> None:
    """Draws one filter in all panels of a system, shifted so that bars do not hide each other."""
    look = FILTER_LOOKS.get(curve[0].filter, OTHER)
    name = curve[0].filter.upper()
    x = [point.curvature + shift for point in curve]
    residuals = [point.residual for point in curve]
    column[0].plot(x, residuals, color=look.colour, marker=look.marker, ls=look.line)
    draw_estimates(column[1], x, [point.nees for point in curve], look, label=f"NEES, {name}")
    nis = [point.nis for point in curve]
    draw_estimates(column[1], x, nis, look, label=f"NIS, {name}", **NIS_STYLE)
    draw_estimates(column[2], x, [point.loss for point in curve], look)
