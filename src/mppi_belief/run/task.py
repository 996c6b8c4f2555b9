"""What a study runs, how much of it, and how it ended."""

from collections.abc import Callable
from typing import Any, NamedTuple

from .plan import WHOLE, Shard


class Task(NamedTuple):
    """What a study runs, as functions a worker can import.

    check(config) raises where a configuration cannot be run; run_trials(config, trials) returns an
    object with `rows`, `paths` and `scene`; time_steps(config) returns seconds of single control steps;
    failed_row(config, trial, status, error) is the row of a trial without result; record(config) returns
    one trial in detail as JSON, where a cell asks for it; device(config) names what computes it, and raises where
    that is not there.
    """

    check: Callable[..., None]
    run_trials: Callable[..., Any]
    time_steps: Callable[..., list[float]]
    failed_row: Callable[..., dict[str, Any]]
    record: Callable[..., dict[str, Any]]
    device: Callable[..., str]


class Order(NamedTuple):
    """How much of a study is run.

    n_trials      of each cell              shard    which part of them
    retry_failed  run those without a result again
    seconds       that one trial, or one batch of them, may take; None: any time
    """

    n_trials: int
    shard: Shard = WHOLE
    retry_failed: bool = False
    seconds: float | None = None


class Outcome(NamedTuple):
    """How a study ended: trials run now and found done, by cell id, and the signal that stopped it, if any."""

    ran: dict[str, int]
    found: dict[str, int]
    stopped: int | None
