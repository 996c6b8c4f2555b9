"""Turns a cell's configuration into rows: the trials that a worker runs.

A cell's configuration is a plain dict: what each of its parts is built from, the `names` chosen for
them, a `seed`, a `precision`, a `platform`, a `batch`, and what was `swept`. A worker gets nothing
else, so a row depends on nothing else.

A batch is one program for `batch` trials. Its last digits may depend on the position of a trial in
it, so trial i always has position i mod `batch`; positions of trials that are not wanted repeat one
that is.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..config.cell import batches, labels
from ..config.targets import with_source_line
from ..errors import ConfigError
from ..problem import Controller, Filter, Problem
from ..results.columns import Consistency, Metrics
from ..simulate import Trial, simulate_trial
from ..trial_metrics import consistency, metrics
from .build import CellParts, build
from .device import computing
from .scene import describe_scene

KEPT_PATHS = 50  # number of first trials whose trajectories are kept, for figures


class Batch(NamedTuple):
    """Holds the results of some trials."""

    rows: list[dict[str, Any]]  # one per trial
    paths: list[dict[str, Any]]  # one per step of each trial whose path is kept
    scene: dict[str, Any] | None  # see `describe_scene`; None if no path is kept


class JudgedTrial(NamedTuple):
    """Holds a trial with what its row says of it."""

    metrics: Metrics
    consistency: Consistency
    trial: Trial


def run_trials(
    config: dict[str, Any],
    trials: Sequence[int],
    path_limit: int = KEPT_PATHS,
    on_error: Callable[[Exception], object] = lambda error: None,
) -> Batch:
    """Runs some trials of a cell, in ascending order, a batch at a time.

    An exception in a trial becomes the status of its row, and `on_error` is called with it. The
    paths of trials below `path_limit` are returned too. Raises `ConfigError` for a configuration
    that cannot be run.
    """
    rows: list[dict[str, Any]] = []
    paths: list[dict[str, Any]] = []
    with computing(config):
        parts = build(config)
        for batch in batches(trials, config["batch"]):
            for trial, outcome in _run_batch(parts, config, batch):
                if isinstance(outcome, Exception):
                    on_error(outcome)
                    rows.append(failed_row(config, trial, "error", _reason(outcome)))
                    continue
                rows.append(_row(config, trial, outcome))
                if trial < path_limit:
                    paths += _path_rows(trial, outcome.trial)
        scene = describe_scene(parts.problem) if paths else None
    return Batch(rows, paths, scene)


def _run_batch(
    parts: CellParts, config: dict[str, Any], trials: Sequence[int]
) -> Iterator[tuple[int, JudgedTrial | Exception]]:
    """Yields each trial of one batch with its outcome.

    A batch that raises is halved until the trial that raises is alone.
    """
    size = config["batch"]
    try:
        results = _judged_trials(parts, config["seed"], _batch_positions(trials, size))
    except Exception as error:
        if size > 1 and "RESOURCE_EXHAUSTED" in str(error):
            raise ConfigError(
                f"batch={size}: too many trials for the memory of the device at once"
            ) from error
        if len(trials) == 1:
            yield trials[0], error
            return
        middle = len(trials) // 2
        yield from _run_batch(parts, config, trials[:middle])
        yield from _run_batch(parts, config, trials[middle:])
        return
    for trial in trials:
        yield trial, results if size == 1 else _at_position(results, trial % size)


def _judged_trials(parts: CellParts, seed: int, trials: int | np.ndarray) -> JudgedTrial:
    """Returns one trial or, with one more axis (B,) in front of all results, those of a batch."""
    trial_metrics, result = simulate_and_judge(*parts, seed, trials)
    compared = judge_filter(parts.problem, parts.filter, result)
    return jax.device_get(JudgedTrial(trial_metrics, compared, result))


def _at_position(results: JudgedTrial, position: int) -> JudgedTrial:
    """Returns the trial at one position of a batch."""
    return jax.tree.map(lambda values: values[position], results)


def _batch_positions(trials: Sequence[int], size: int) -> int | np.ndarray:
    """Returns the trial at each position of a batch (size,); for batches of one just the trial."""
    if size == 1:
        return trials[0]
    positions = np.full(size, trials[0])
    positions[[trial % size for trial in trials]] = trials
    return positions


@jax.jit
def simulate_and_judge(
    problem: Problem, filter: Filter, controller: Controller, seed: Any, trial: Any
) -> tuple[Metrics, Trial]:
    """Simulates and judges a trial () or a batch of them (B,)."""

    def run_one(trial: Any) -> tuple[Metrics, Trial]:
        result = simulate_trial(problem, filter, controller, seed, trial)
        return metrics(problem, result), result

    return jax.vmap(run_one)(trial) if jnp.ndim(trial) else run_one(trial)


@jax.jit
def judge_filter(problem: Problem, filter: Filter, result: Trial) -> Consistency:
    """Judges the filter in a trial or a batch; all controllers share this program."""

    def compare_one(result: Trial) -> Consistency:
        return consistency(problem, filter, result)

    return jax.vmap(compare_one)(result) if result.ess.ndim == 2 else compare_one(result)


def _row(config: dict[str, Any], trial: int, judged: JudgedTrial) -> dict[str, Any]:
    """Returns the row of a trial that was run to its end."""
    numbers = judged.metrics._asdict() | judged.consistency._asdict()
    error = divergence(judged.metrics, judged.trial)
    return {
        **_labels(config, trial, "diverged" if error else "ok"),
        **{name: value.item() for name, value in numbers.items()},
        "steps": len(judged.trial.controls),
        "error": error,
    }


def failed_row(config: dict[str, Any], trial: int, status: str, error: str) -> dict[str, Any]:
    """Returns the row of a trial that has no results."""
    absent = dict.fromkeys((*Metrics._fields, *Consistency._fields), float("nan"))
    return {
        **_labels(config, trial, status),
        **absent,
        "collided": None,
        "steps": 0,
        "error": error,
    }


def _labels(config: dict[str, Any], trial: int, status: str) -> dict[str, Any]:
    """Returns the trial, its status and the labels of its cell, in the order of a row."""
    own = {"trial": trial, "status": status}
    return own | {name: value for name, value in labels(config).items() if name not in own}


def _reason(error: Exception) -> str:
    """Returns what an exception says, and the line of the user's own code that raised it.

    That of a callback comes with a traceback, which differs with who runs it and where; of it only
    the last line is taken.
    """
    text = f"{type(error).__name__}: {error}".strip()
    if "Traceback (most recent call last)" in text:
        text = text.splitlines()[-1]
    return with_source_line(text, error)


def divergence(judged: Metrics, result: Trial) -> str | None:
    """Returns what left the finite numbers in a trial, None if nothing did."""
    quantities: dict[str, Any] = {
        "state": result.states,
        "belief": np.append(result.beliefs.mean, result.beliefs.cov),
        "control": result.controls,
        "cost": judged.cost,
    }
    lost = [name for name, values in quantities.items() if not np.all(np.isfinite(values))]
    if np.isnan(judged.clearance):
        lost.append("clearance")
    if not lost and np.any(np.asarray(result.ess) == 0):
        lost = ["cost of every sampled path of a step"]
    return f"the {' and the '.join(lost)} left the finite numbers" if lost else None


def _path_rows(trial: int, result: Trial) -> list[dict[str, Any]]:
    """Returns a row per step 0..T of a trial; after the last step there is no control (nan)."""
    controls = np.vstack([result.controls, np.full_like(result.controls[:1], np.nan)])
    columns = zip(result.states, result.beliefs.mean, result.beliefs.cov, controls, strict=True)
    return [
        {"trial": trial, "step": k, "state": x, "mean": mean, "cov": cov.ravel(), "control": u}
        for k, (x, mean, cov, u) in enumerate(columns)
    ]
