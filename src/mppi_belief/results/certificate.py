"""What a certificate says: a statement of the paper, the numbers that test it, and where each band comes from.

A band is derived, never tuned. Three ways to derive one are written here once:

* rounding: a number of operations times the machine epsilon times the size of what is rounded;
* Monte Carlo: a quantile of Student's t for a chance of `FALSE_ALARM` that a true statement fails the check,
  shared among the points that the check looks at;
* discretisation: errors e(h) = C h^p (1 + c h + ...) have the observed order p + O(h): halving h brings it nearer to
  p by about as much as is then left, so it must lie within twice its last change, and nearer than before.

Other bands are bounds that a certificate proves itself, or tolerances that a solver was asked for.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

NAMES = (
    "affine_observations",
    "belief_dynamics",
    "deterministic_covariance",
    "matching_feasibility",
    "matching_residual",
    "cole_hopf",
    "feynman_kac",
    "control_law",
    "entropic_risk",
    "algorithm_1",
    "joint_covariance",
    "controlled_sensing",
)  # modules of `mppi_belief.verify`, in the order of the paper, then what goes beyond it
FALSE_ALARM = 1e-4
EPSILON = float(np.finfo(np.float64).eps)


class Check(NamedTuple):
    """One number and the band it must lie in; `derived` says where the band comes from."""

    computed: str
    value: float
    low: float
    high: float
    derived: str

    @property
    def holds(self) -> bool:
        """Whether the value lies in its band; a value that is no number does not."""
        return self.low <= self.value <= self.high

    @property
    def band(self) -> str:
        """The band as text."""
        if math.isinf(self.low):
            return f"≤ {self.high:.3g}"
        if math.isinf(self.high):
            return f"≥ {self.low:.3g}"
        middle, half = (self.low + self.high) / 2, (self.high - self.low) / 2
        if half == 0:
            return f"= {middle:.6g}"
        if half < 1e-4 * abs(middle):
            return f"{middle:.6g} ± {half:.1g}"
        return f"[{self.low:.5g}, {self.high:.5g}]"


class Line(NamedTuple):
    """One curve of a panel; `look` is "line", "dashed" or "points", `low` and `high` an interval around y."""

    label: str
    x: Sequence[float]
    y: Sequence[float]
    look: str = "line"
    low: Sequence[float] | None = None
    high: Sequence[float] | None = None


class Panel(NamedTuple):
    """One set of axes: title, axis labels with units, curves; `log` names the logarithmic axes, as "xy"."""

    title: str
    x: str
    y: str
    lines: Sequence[Line]
    log: str = ""


class Certificate(NamedTuple):
    """A statement of the paper with its checks; `text` says what was done, and what the statement does not cover."""

    name: str
    statement: str
    text: str
    checks: Sequence[Check]
    panels: Sequence[Panel] = ()

    @property
    def holds(self) -> bool:
        """Whether every check holds; without any there is nothing to hold."""
        return bool(self.checks) and all(check.holds for check in self.checks)


def at_most(computed: str, value: float, high: float, derived: str) -> Check:
    """value <= high."""
    return Check(computed, float(value), -math.inf, float(high), derived)


def at_least(computed: str, value: float, low: float, derived: str) -> Check:
    """value >= low."""
    return Check(computed, float(value), float(low), math.inf, derived)


def near(computed: str, value: float, target: float, tolerance: float, derived: str) -> Check:
    """|value - target| <= tolerance."""
    return Check(
        computed,
        float(value),
        float(target) - float(tolerance),
        float(target) + float(tolerance),
        derived,
    )


def rounding(computed: str, error: float, operations: float, scale: float = 1.0) -> Check:
    """A number that is zero but for rounding: at most `operations` roundings of numbers of size `scale`."""
    derived = f"rounding: {operations:g} operations on numbers of size {scale:.2g}"
    return at_most(computed, abs(error), operations * EPSILON * scale, derived)


def quantile(points: int = 1, degrees: float = math.inf) -> float:
    """How many standard errors a true statement stays within at all of `points` points, but for `FALSE_ALARM`;
    `degrees` of freedom if the standard error was itself estimated."""
    from scipy.stats import (
        t as student_t,
    )  # a second to import, and the command line needs but the names

    return float(student_t.isf(FALSE_ALARM / (2 * points), degrees))


def within_errors(
    computed: str,
    estimate: float,
    target: float,
    error: float,
    degrees: float = math.inf,
    bias: float = 0.0,
) -> Check:
    """A Monte Carlo estimate of standard error `error` against the true value, known up to `bias`."""
    derived = f"{quantile(1, degrees):.1f} standard errors" + (
        f" and a bias of {bias:.1g}" if bias else ""
    )
    return near(computed, estimate, target, quantile(1, degrees) * error + bias, derived)


def largest_z(computed: str, z: Any, degrees: float = math.inf) -> Check:
    """Monte Carlo estimates at many points, each as its distance from the truth in standard errors."""
    scores = np.abs(np.asarray(z, dtype=float)).ravel()
    derived = f"standard errors; the quantile for {scores.size} points"
    return at_most(computed, float(np.max(scores)), quantile(scores.size, degrees), derived)


def observed_orders(errors: Sequence[float], ratio: float = 2.0) -> np.ndarray:
    """log(e_j / e_{j+1}) / log(ratio) for errors (J,) on grids each `ratio` times finer than the one before."""
    e = np.asarray(errors, dtype=float)
    return np.log(e[:-1] / e[1:]) / math.log(ratio)


def order(computed: str, expected: float, errors: Sequence[float], ratio: float = 2.0) -> Check:
    """The order seen on the two finest grids against the scheme's; needs errors on three grids or more.

    It must be no farther from `expected` than twice its last change, nor than the order on the coarser pair: an error
    that stalls on another limit has orders that drift away.
    """
    orders = observed_orders(errors, ratio)
    tolerance = min(2 * abs(orders[-1] - orders[-2]), abs(orders[-2] - expected)) + 16 * EPSILON
    derived = "order of the scheme: twice its last change, and nearer than before"
    return near(computed, orders[-1], expected, tolerance, derived)


def as_dict(certificate: Certificate) -> dict[str, Any]:
    """The certificate for JSON; what is not finite becomes None."""
    panels = [
        panel._asdict() | {"lines": [_plain(line._asdict()) for line in panel.lines]}
        for panel in certificate.panels
    ]
    return certificate._asdict() | {
        "checks": [_plain(check._asdict()) for check in certificate.checks],
        "panels": panels,
    }


def from_dict(stored: Mapping[str, Any]) -> Certificate:
    """The certificate that `as_dict` made this of."""
    checks = [
        Check(
            c["computed"],
            _number(c["value"]),
            _bound(c["low"], -1),
            _bound(c["high"], 1),
            c["derived"],
        )
        for c in stored["checks"]
    ]
    panels = [
        Panel(**{**panel, "lines": [_line(line) for line in panel["lines"]]})
        for panel in stored["panels"]
    ]
    return Certificate(**{**stored, "checks": checks, "panels": panels})


def _plain(value: Any) -> Any:
    """Lists of finite floats for what JSON cannot hold."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, str) or value is None:
        return value
    return float(value) if math.isfinite(value) else None


def _line(stored: Mapping[str, Any]) -> Line:
    curves = {
        name: None if stored[name] is None else [_number(value) for value in stored[name]]
        for name in ("x", "y", "low", "high")
    }
    return Line(**{**stored, **curves})


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _bound(value: float | None, side: int) -> float:
    return side * math.inf if value is None else value
