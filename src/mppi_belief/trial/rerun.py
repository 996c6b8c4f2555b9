"""Runs one trial again and compares it, bit for bit, with its stored row and path."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from .trials import Batch, run_trials

PATH_QUANTITIES = ("state", "mean", "cov", "control")  # columns of a path that are compared


class Difference(NamedTuple):
    """Holds one column in which the new run differs from the stored trial."""

    name: str  # the column
    then: Any  # the first value that differs, as it was stored
    now: Any  # the same value of the new run
    ulp: int | None  # largest distance of two values, in steps of the precision; None: no numbers
    values: int  # how many values of this column differ
    location: str  # where along the path the first one is; empty for a value of the row


def rerun(
    config: dict[str, Any],
    trial: int,
    on_error: Callable[[Exception], object] = lambda error: None,
) -> Batch:
    """Runs one trial at its position in its batch, and keeps its path.

    `on_error` is called with an exception of the trial. Raises `ConfigError` where the
    configuration cannot be run.
    """
    return run_trials(config, [trial], trial + 1, on_error)


def differences(
    row_then: dict[str, Any],
    row_now: dict[str, Any],
    path_then: Sequence[dict[str, Any]],
    path_now: Sequence[dict[str, Any]],
    precision: str,
) -> list[Difference]:
    """Returns what differs between two rows and two paths, a step of a path being a dict.

    The columns compared are those of `row_then`, and `PATH_QUANTITIES` if the path was stored.
    `precision` is "float32" or "float64".
    """
    compared = [
        _compare_values(name, value, row_now.get(name), precision)
        for name, value in row_then.items()
    ]
    n_then = len(path_then)
    n_now = len(path_now)
    if path_then and n_then != n_now:
        compared.append(Difference("steps of the path", n_then, n_now, None, 1, ""))
    elif path_then:
        compared += [
            _compare_paths(name, path_then, path_now, precision) for name in PATH_QUANTITIES
        ]
    return [difference for difference in compared if difference is not None]


def _compare_values(name: str, then: Any, now: Any, precision: str) -> Difference | None:
    """Compares two values of a row."""
    if isinstance(then, float) and isinstance(now, float):
        if _same_bits(np.array([then]), np.array([now])).all():
            return None
        return Difference(name, then, now, ulps(then, now, precision), 1, "")
    if then == now:
        return None
    return Difference(name, then, now, None, 1, "")


def _compare_paths(
    name: str,
    path_then: Sequence[dict[str, Any]],
    path_now: Sequence[dict[str, Any]],
    precision: str,
) -> Difference | None:
    """Compares one quantity along two paths of the same length."""
    then = np.array([step[name] for step in path_then], dtype=np.float64)
    now = np.array([step[name] for step in path_now], dtype=np.float64)
    if then.shape != now.shape:
        sizes = [f"{values.shape[1]} values per step" for values in (then, now)]
        return Difference(name, sizes[0], sizes[1], None, 1, "")
    differing = [tuple(index) for index in np.argwhere(~_same_bits(then, now))]
    if not differing:
        return None
    distances = [ulps(then[index], now[index], precision) for index in differing]
    largest = max((ulp for ulp in distances if ulp is not None), default=None)
    step, component = differing[0]
    location = f"step {path_then[step]['step']}, component {component}"
    first_then = float(then[differing[0]])
    first_now = float(now[differing[0]])
    return Difference(name, first_then, first_now, largest, len(differing), location)


def _same_bits(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Returns where float64 values have the same bits, or are both not a number."""
    same = first.view(np.int64) == second.view(np.int64)
    return same | (np.isnan(first) & np.isnan(second))


def ulps(first: float, second: float, precision: str) -> int | None:
    """Returns how many steps of a precision lie between two numbers; None if one is not finite."""
    if not (np.isfinite(first) and np.isfinite(second)):
        return None
    return abs(_rank(first, precision) - _rank(second, precision))


def _rank(value: float, precision: str) -> int:
    """Returns the position of a number among all of its precision, counted from zero."""
    kind: Any = np.dtype(precision).type
    integer = np.dtype(precision).str.replace("f", "i")
    rank = int(abs(kind(value)).view(integer))
    return -rank if value < 0 else rank


def finite_steps(path: Sequence[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yields the steps of a path before it leaves the finite numbers."""
    for step in path:
        if not np.all(np.isfinite(np.concatenate([step["state"], step["mean"], step["cov"]]))):
            return
        yield step
