"""One trial once more: is it what was kept of it, bit for bit?"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from .trials import Batch, run_trials

PATH = ("state", "mean", "cov", "control")


class Difference(NamedTuple):
    """A value that came out otherwise. `ulp` is how many numbers of the trial's precision lie between, None where it
    is no number; so many `values` of that name differ, `place` is the first of them."""

    name: str
    then: Any
    now: Any
    ulp: int | None
    values: int
    place: str


def rerun(config: dict[str, Any], trial: int) -> Batch:
    """Run one trial, at its place in its batch, with its path whichever it is; raises `ConfigError` where that cannot
    be."""
    return run_trials(config, [trial], kept=trial + 1)


def differences(
    then: dict[str, Any],
    now: dict[str, Any],
    path: Sequence[dict[str, Any]],
    again: Sequence[dict[str, Any]],
    bits: str,
) -> list[Difference]:
    """What differs between two rows and two paths; `bits` is the precision, "float32" or "float64". The columns are
    those of `then`; a path of which nothing was kept is not compared."""
    found = [_compare(name, value, now.get(name), bits) for name, value in then.items()]
    if path and len(path) != len(again):
        found.append(Difference("steps of the path", len(path), len(again), None, 1, ""))
    elif path:
        found += [_along(name, path, again, bits) for name in PATH]
    return [one for one in found if one is not None]


def _compare(name: str, then: Any, now: Any, bits: str) -> Difference | None:
    if isinstance(then, float) and isinstance(now, float):
        if _same(np.array([then]), np.array([now])).all():
            return None
        return Difference(name, then, now, ulps(then, now, bits), 1, "")
    return None if then == now else Difference(name, then, now, None, 1, "")


def _along(
    name: str, path: Sequence[dict[str, Any]], again: Sequence[dict[str, Any]], bits: str
) -> Difference | None:
    """The first difference of one quantity along a path, and how many there are; the largest in ulp."""
    then, now = (
        np.array([step[name] for step in steps], dtype=np.float64) for steps in (path, again)
    )
    if then.shape != now.shape:
        return Difference(
            name, f"{then.shape[1]} values a step", f"{now.shape[1]} values a step", None, 1, ""
        )
    other = np.argwhere(~_same(then, now))
    if not len(other):
        return None
    step, at = (int(number) for number in other[0])
    apart = [ulps(then[tuple(one)], now[tuple(one)], bits) for one in other]
    most = max((one for one in apart if one is not None), default=None)
    place = f"step {path[step]['step']}, component {at}"
    return Difference(name, float(then[step, at]), float(now[step, at]), most, len(other), place)


def _same(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Where float64 values have the same bits, or are both not a number."""
    return (one.view(np.int64) == other.view(np.int64)) | (np.isnan(one) & np.isnan(other))


def ulps(one: float, other: float, bits: str) -> int | None:
    """How many steps of a precision lie between two numbers; None if one is not finite."""
    if not (np.isfinite(one) and np.isfinite(other)):
        return None
    return abs(_rank(one, bits) - _rank(other, bits))


def _rank(value: float, bits: str) -> int:
    """The place of a number among all of its precision, 0 for zero and negative for negative ones."""
    kind: Any = np.dtype(bits).type
    found = int(abs(kind(value)).view(np.dtype(bits).str.replace("f", "i")))
    return -found if value < 0 else found


def finite_steps(path: Sequence[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """The steps of a path before it leaves the finite numbers."""
    for step in path:
        if not np.all(np.isfinite(np.concatenate([step["state"], step["mean"], step["cov"]]))):
            return
        yield step
