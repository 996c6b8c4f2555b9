"""Sizes, rates and limits of errors that several certificates estimate."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ..results.certificate import Check
from .bands import at_most


def rms(values: Any) -> float:
    """Returns the root mean square over all entries of an array."""
    return float(np.sqrt(np.mean(np.square(values))))


def largest_magnitude(values: Any) -> float:
    """Returns the largest absolute value of an array."""
    return float(np.max(np.abs(values)))


def standard_error(values: np.ndarray) -> float:
    """Returns the standard error of the mean of values (n,)."""
    return float(np.std(values, ddof=1)) / math.sqrt(len(values))


class RepeatedControls(NamedTuple):
    """Holds controls from independent keys and what their mean should be."""

    controls: np.ndarray  # (keys, points)
    expected: np.ndarray  # (points,)

    @property
    def mean(self) -> np.ndarray:
        """Returns the mean (points,) over the keys."""
        return self.controls.mean(axis=0)

    @property
    def error(self) -> np.ndarray:
        """Returns the standard error (points,) of the mean."""
        return self.controls.std(axis=0, ddof=1) / np.sqrt(len(self.controls))

    @property
    def z(self) -> np.ndarray:
        """Returns the distances (points,) of the mean from its expectation in standard errors."""
        return (self.mean - self.expected) / self.error


def fitted_rate(
    sizes: np.ndarray, rms_errors: np.ndarray, relative_errors: np.ndarray
) -> tuple[float, float]:
    """Returns the slope of log RMS error over log N and the standard error of this slope.

    The fit is by weighted least squares over sizes N (J,), RMS errors (J,) and the relative
    standard errors (J,) of these.
    """
    log_size = np.log(sizes)
    log_rms = np.log(rms_errors)
    weights = 1 / np.asarray(relative_errors) ** 2
    deviation = log_size - np.average(log_size, weights=weights)
    spread = np.sum(weights * deviation**2)
    slope = float(np.sum(weights * deviation * log_rms) / spread)
    return slope, float(1 / np.sqrt(spread))


def extrapolations(levels: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Returns Richardson's extrapolations of values with an error of first order in the step.

    The step of each level is half as long as that of the previous level.
    """
    return [2 * fine - coarse for coarse, fine in pairwise(levels)]


def limit_check(
    computed: str, levels: Sequence[np.ndarray], exact: np.ndarray, error: np.ndarray
) -> Check:
    """Returns the check of levels (J, n), extrapolated to a step of zero, against exact (n,).

    The exact values are known to within `error` (n,).
    """
    *_, before, limit = extrapolations(levels)
    return at_most(
        computed,
        np.max(np.abs(limit - exact) / (np.abs(limit - before) + error)),
        1.0,
        "change from the coarser, three times what is left, and the grid's error",
    )
