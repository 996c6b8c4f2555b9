"""Describes what a study runs, how much of it, and how it ended."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from .plan import WHOLE, Shard

Row = dict[str, Any]  # the results of one trial, see `results.columns`


class TrialFunctions(NamedTuple):
    """Names what is done for a cell, as functions of its configuration that a worker can import.

    `run` knows nothing else of a trial.
    """

    check: Callable[..., Sequence[str]]  # (config); notes; raises where it cannot be run
    run_trials: Callable[..., Any]  # (config, trials); an object with `rows`, `paths` and `scene`
    time_steps: Callable[..., dict[str, Any]]  # (config); times and load, see `timing_load`
    failed_row: Callable[..., Row]  # (config, trial, status, error); a row without result
    record: Callable[..., dict[str, Any]]  # (config); one trial in detail as JSON
    device: Callable[..., str]  # (config); the name of what computes, raises where that is missing


class StudyOrder(NamedTuple):
    """Says how much of a study is run."""

    n_trials: int  # of each cell
    shard: Shard = WHOLE  # which part of them
    retry_failed: bool = False  # whether trials without a result run again
    seconds: float | None = None  # s that one batch of trials may take; None: any time


class StudyOutcome(NamedTuple):
    """Says how a study ended."""

    ran: dict[str, int]  # trials that were run now, by cell id
    done_before: dict[str, int]  # trials that were done before, by cell id
    stopped: int | None  # the signal that stopped it, if one did
