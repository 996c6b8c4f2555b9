"""Describes a certificate: a statement of the paper, the numbers that test it, their bands.

`CERTIFICATE_NAMES` is the one list of certificates. Each name is a module of
`mppi_belief.verify.certificates`, which derives its bands with `mppi_belief.verify.bands`.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

CERTIFICATE_NAMES = (
    # In the order of the paper.
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
    # Beyond the paper.
    "joint_covariance",
    "controlled_sensing",
    "compact_penalty",
)


class Check(NamedTuple):
    """Holds one number and the band in which it must lie."""

    computed: str  # what the number is
    value: float
    low: float  # lower end of the band, -inf if there is none
    high: float  # upper end of the band, inf if there is none
    derived: str  # where the band comes from

    @property
    def holds(self) -> bool:
        """Returns whether the value lies in its band; NaN does not."""
        return self.low <= self.value <= self.high

    @property
    def band(self) -> str:
        """Returns the band as text."""
        if math.isinf(self.low):
            return f"≤ {self.high:.3g}"
        if math.isinf(self.high):
            return f"≥ {self.low:.3g}"
        middle = (self.low + self.high) / 2
        half_width = (self.high - self.low) / 2
        if half_width == 0:
            return f"= {middle:.6g}"
        if half_width < 1e-4 * abs(middle):
            return f"{middle:.6g} ± {half_width:.1g}"
        return f"[{self.low:.5g}, {self.high:.5g}]"


class Line(NamedTuple):
    """Holds one curve of a panel."""

    label: str
    x: Sequence[float]  # (n,)
    y: Sequence[float]  # (n,)
    look: str = "line"  # "line", "dashed" or "points"
    low: Sequence[float] | None = None  # (n,), lower ends of intervals around y
    high: Sequence[float] | None = None  # (n,), upper ends of these intervals


class Panel(NamedTuple):
    """Holds one set of axes and its curves."""

    title: str
    x: str  # label of the horizontal axis, with its unit
    y: str  # label of the vertical axis, with its unit
    lines: Sequence[Line]
    log: str = ""  # the logarithmic axes: "", "x", "y" or "xy"


class Certificate(NamedTuple):
    """Holds a statement of the paper with its checks."""

    name: str  # one of `CERTIFICATE_NAMES`, or the name of a system
    statement: str
    text: str  # what was computed, and what the statement does not cover
    checks: Sequence[Check]
    panels: Sequence[Panel] = ()

    @property
    def holds(self) -> bool:
        """Returns whether there are checks and all of them hold."""
        return bool(self.checks) and all(check.holds for check in self.checks)


def as_dict(certificate: Certificate) -> dict[str, Any]:
    """Returns the certificate for JSON; numbers that are not finite become None."""
    panels = [
        panel._asdict() | {"lines": [_plain(line._asdict()) for line in panel.lines]}
        for panel in certificate.panels
    ]
    return certificate._asdict() | {
        "checks": [_plain(check._asdict()) for check in certificate.checks],
        "panels": panels,
    }


def from_dict(stored: Mapping[str, Any]) -> Certificate:
    """Returns the certificate from which `as_dict` made `stored`."""
    checks = [
        Check(
            computed=check["computed"],
            value=_number(check["value"]),
            low=_bound(check["low"], -1),
            high=_bound(check["high"], 1),
            derived=check["derived"],
        )
        for check in stored["checks"]
    ]
    panels = [
        Panel(**{**panel, "lines": [_line(line) for line in panel["lines"]]})
        for panel in stored["panels"]
    ]
    return Certificate(**{**stored, "checks": checks, "panels": panels})


def _plain(value: Any) -> Any:
    """Returns lists of finite floats for what JSON cannot hold."""
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
