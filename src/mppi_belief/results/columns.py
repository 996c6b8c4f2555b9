"""The columns of a results table, which are named here and nowhere else.

A row holds the results of one trial. It is a dict from column to value; further columns of a row
are swept settings. A trial ends with one of these statuses: "ok"; "diverged" (its numbers are no
longer finite); "error", "crashed" or "timeout" (it has no result).
"""

from typing import Any, NamedTuple

import pyarrow as pa


class Metrics(NamedTuple):
    """Judges a trial by its cost, its collisions and its samples, each a number ().

    Costs are those of eq. (2) on the true state without the obstacle penalty, with the integral
    taken as sum_k (base(x_k) + 1/2 u_k' R u_k) dt over k = 0..T-1.
    """

    cost: Any  # running_cost + terminal_cost
    running_cost: Any  # the integral
    terminal_cost: Any  # the cost of the last state
    collided: Any  # bool, whether the path touches an obstacle, at a state or between two
    clearance: Any  # m, the least distance of the path to an obstacle; its steps are straight
    final_distance: Any  # m, distance from the last position to that of the goal
    ess: Any  # effective sample size, averaged over the steps; 1 to the number of samples


class Consistency(NamedTuple):
    """Compares a filter's errors with what it claims: means over the T steps of a trial, each
    a number ().

    Steps with a singular covariance are left out; the mean is nan where that is all of them.
    """

    nees: Any  # normalised squared estimation error (x - mean)' cov^-1 (x - mean), about nx
    nis: Any  # normalised squared innovation d' S^-1 d of a measurement, about ny


# Statuses of trials that the same configuration would end in the same way again.
FINAL_STATUSES = ("ok", "diverged")

_METRICS = (*Metrics._fields, *Consistency._fields)
COLUMN_TYPES: dict[str, pa.DataType] = {
    "trial": pa.int64(),
    "seed": pa.int64(),
    "status": pa.string(),
    "controller": pa.string(),
    "theta": pa.float64(),
    "w_obs": pa.float64(),
    **{name: pa.bool_() if name == "collided" else pa.float64() for name in _METRICS},
    "steps": pa.int64(),  # control steps that were made
    "error": pa.string(),  # why there is no result, or what diverged; None for "ok"
}
COLUMNS = tuple(COLUMN_TYPES)  # the columns that the rows of all cells have

PATH_TYPES: dict[str, pa.DataType] = {
    "trial": pa.int64(),
    "step": pa.int64(),
    "state": pa.list_(pa.float64()),  # (nx,)
    "mean": pa.list_(pa.float64()),  # (nx,) of the belief
    "cov": pa.list_(pa.float64()),  # (nx * nx,) of the belief, row by row
    "control": pa.list_(pa.float64()),  # (nu,), nan at the last step
}
PATH_COLUMNS = tuple(PATH_TYPES)
