"""Checks whose bands are derived, never tuned. Three derivations are implemented here.

* Rounding: a number of operations times the machine epsilon times the size of the numbers that are
  rounded.
* Monte Carlo: a quantile of Student's t at which a true statement fails with probability
  `FALSE_ALARM`, shared among the points at which the check looks.
* Discretisation: errors e(h) = C h^p (1 + c h + ...) have the observed order p + O(h). Halving h
  halves the distance of the observed order from p. The observed order must therefore lie within
  twice its last change of p, and nearer to p than the order on the coarser pair of grids.

Other bands are bounds that a certificate proves itself, or tolerances that were given to a solver.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..results.certificate import Check

FALSE_ALARM = 1e-4  # probability with which a true statement fails a Monte Carlo check
EPSILON = float(np.finfo(np.float64).eps)  # machine epsilon of double precision


def at_most(computed: str, value: float, high: float, derived: str) -> Check:
    """Returns the check value <= high."""
    return Check(computed, float(value), -math.inf, float(high), derived)


def at_least(computed: str, value: float, low: float, derived: str) -> Check:
    """Returns the check value >= low."""
    return Check(computed, float(value), float(low), math.inf, derived)


def near(computed: str, value: float, target: float, tolerance: float, derived: str) -> Check:
    """Returns the check |value - target| <= tolerance."""
    low = float(target) - float(tolerance)
    high = float(target) + float(tolerance)
    return Check(computed, float(value), low, high, derived)


def rounding(computed: str, error: float, operations: float, scale: float = 1.0) -> Check:
    """Returns the check of an error that is zero except for rounding.

    The band is that of `operations` roundings of numbers of size `scale`.
    """
    derived = f"rounding: {operations:g} operations on numbers of size {scale:.2g}"
    return at_most(computed, abs(error), operations * EPSILON * scale, derived)


def quantile(points: int = 1, degrees: float = math.inf) -> float:
    """Returns the number of standard errors that bounds the errors at all of `points` points.

    If the statement is true, some error exceeds it with probability `FALSE_ALARM` at most.
    `degrees` of freedom are finite where the standard error was itself estimated.
    """
    # Importing SciPy's distributions takes a second, and some callers need only the checks.
    from scipy.stats import t as student_t

    return float(student_t.isf(FALSE_ALARM / (2 * points), degrees))


def within_errors(
    computed: str,
    estimate: float,
    target: float,
    error: float,
    degrees: float = math.inf,
    bias: float = 0.0,
) -> Check:
    """Returns the check of a Monte Carlo estimate against its target.

    `error` is the standard error of the estimate and `bias` bounds the error of the target.
    """
    allowance = f" and a bias of {bias:.1g}" if bias else ""
    derived = f"{quantile(1, degrees):.1f} standard errors{allowance}"
    return near(computed, estimate, target, quantile(1, degrees) * error + bias, derived)


def largest_z(computed: str, z: Any, degrees: float = math.inf) -> Check:
    """Returns the check of Monte Carlo estimates at many points.

    `z` (any shape) holds the distance of each estimate from its target in standard errors.
    """
    scores = np.abs(np.asarray(z, dtype=float)).ravel()
    derived = f"standard errors; the quantile for {scores.size} points"
    return at_most(computed, float(np.max(scores)), quantile(scores.size, degrees), derived)


def observed_orders(errors: Sequence[float], ratio: float = 2.0) -> np.ndarray:
    """Returns log(e_j / e_{j+1}) / log(ratio) (J - 1,) of errors (J,).

    Each grid is `ratio` times finer than the previous one.
    """
    e = np.asarray(errors, dtype=float)
    return np.log(e[:-1] / e[1:]) / math.log(ratio)


def order(computed: str, expected: float, errors: Sequence[float], ratio: float = 2.0) -> Check:
    """Returns the check of the order on the two finest grids, given errors (J,) with J >= 3.

    The order may differ from `expected` by at most twice its last change, and by no more than the
    order on the coarser pair of grids does: an error that stalls on a wrong limit has orders that
    drift away.
    """
    orders = observed_orders(errors, ratio)
    last_change = abs(orders[-1] - orders[-2])
    coarser_distance = abs(orders[-2] - expected)
    tolerance = min(2 * last_change, coarser_distance) + 16 * EPSILON
    derived = "order of the scheme: twice its last change, and nearer than before"
    return near(computed, orders[-1], expected, tolerance, derived)
