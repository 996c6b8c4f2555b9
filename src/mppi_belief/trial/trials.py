"""From a cell's configuration to rows: the trials a worker runs.

A cell's configuration is a plain dict: what each of its parts is built from, the `names` chosen for them, a
`seed`, a `precision`, a `platform`, a `batch`, and what was `swept`. It is all a worker gets, so a row depends on
nothing else.

A batch is one program for `batch` trials. Its last digits may depend on the place a trial has in it, so trial i
always has place i mod `batch`; places of trials that are not wanted repeat one that is.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..config.cell import batches, labels
from ..errors import ConfigError
from ..problem import Controller, Filter, Problem
from ..results.columns import Consistency, Metrics
from ..simulate import Trial, simulate_trial
from ..trial_metrics import consistency, metrics
from .build import Experiment, build
from .device import computing
from .scene import describe_scene

KEPT_PATHS = 50  # trajectories are kept for the first so many trials, for figures


class Batch(NamedTuple):
    """Results of some trials: one row each, one path row per step of each kept trial, the scene they ran in."""

    rows: list[dict[str, Any]]
    paths: list[dict[str, Any]]
    scene: dict[str, Any] | None


class Judged(NamedTuple):
    """What the numbers of a row come from."""

    metrics: Metrics
    consistency: Consistency


@jax.jit
def _run(
    problem: Problem, filter: Filter, controller: Controller, seed: Any, trial: Any
) -> tuple[Metrics, Trial]:
    """One trial () or, with one more axis at the front of all results, those of a batch (B,)."""

    def one(trial: Any) -> tuple[Metrics, Trial]:
        result = simulate_trial(problem, filter, controller, seed, trial)
        return metrics(problem, result), result

    return jax.vmap(one)(trial) if jnp.ndim(trial) else one(trial)


@jax.jit
def _compare(problem: Problem, filter: Filter, result: Trial) -> Consistency:
    """The same for its consistency: a program of its own, which all controllers share."""

    def one(result: Trial) -> Consistency:
        return consistency(problem, filter, result)

    return jax.vmap(one)(result) if result.ess.ndim == 2 else one(result)


def run_trials(config: dict[str, Any], trials: Sequence[int], kept: int = KEPT_PATHS) -> Batch:
    """Run some trials of a cell (ascending), a batch at a time; an exception in one becomes its row's status. The
    trajectories of the first `kept` trials are told too."""
    rows, paths = [], []
    with computing(config):
        parts = build(config)
        for together in batches(trials, config["batch"]):
            for trial, outcome in _outcomes(parts, config, together):
                if isinstance(outcome, Exception):
                    rows.append(failed_row(config, trial, "error", _reason(outcome)))
                    continue
                judged, result = outcome
                rows.append(_row(config, trial, judged, result))
                if trial < kept:
                    paths += _path_rows(trial, result)
        scene = describe_scene(parts.problem) if paths else None
    return Batch(rows, paths, scene)


def _outcomes(
    parts: Experiment, config: dict[str, Any], trials: Sequence[int]
) -> Iterator[tuple[int, tuple[Judged, Trial] | Exception]]:
    """What became of each of the trials of one batch; a batch that raises is halved, down to the trial that does."""
    size = config["batch"]
    try:
        judged, result = _run(*parts, config["seed"], _places(trials, size))
        compared = _compare(parts.problem, parts.filter, result)
        results = jax.device_get((Judged(judged, compared), result))
    except Exception as error:
        if size > 1 and "RESOURCE_EXHAUSTED" in str(error):
            raise ConfigError(
                f"batch={size}: too many trials for the memory of the device at once"
            ) from error
        if len(trials) == 1:
            yield trials[0], error
            return
        middle = len(trials) // 2
        yield from _outcomes(parts, config, trials[:middle])
        yield from _outcomes(parts, config, trials[middle:])
        return
    for trial in trials:
        yield (
            trial,
            results
            if size == 1
            else jax.tree.map(lambda values, at=trial % size: values[at], results),
        )


def _places(trials: Sequence[int], size: int) -> int | np.ndarray:
    """The trial at each place of their batch (size,); of a batch of one just the trial."""
    if size == 1:
        return trials[0]
    places = np.full(size, trials[0])
    places[[trial % size for trial in trials]] = trials
    return places


def _row(config: dict[str, Any], trial: int, judged: Judged, result: Trial) -> dict[str, Any]:
    values = {name: value.item() for part in judged for name, value in part._asdict().items()}
    error = divergence(judged.metrics, result)
    status = "diverged" if error else "ok"
    return {
        **_labels(config, trial, status),
        **values,
        "steps": len(result.controls),
        "error": error,
    }


def _reason(error: Exception) -> str:
    """What an exception says; a callback's comes with a traceback, which differs with whoever runs it and where."""
    text = f"{type(error).__name__}: {error}".strip()
    return text.splitlines()[-1] if "Traceback (most recent call last)" in text else text


def divergence(judged: Metrics, result: Trial) -> str | None:
    """What left the finite numbers in a trial, if anything did."""
    parts: dict[str, Any] = {
        "state": result.states,
        "belief": np.append(result.beliefs.mean, result.beliefs.cov),
    }
    parts |= {"control": result.controls, "cost": judged.cost}
    lost = [name for name, values in parts.items() if not np.all(np.isfinite(values))]
    if not lost and np.any(np.asarray(result.ess) == 0):
        lost = ["cost of every sampled path of a step"]
    return f"the {' and the '.join(lost)} left the finite numbers" if lost else None


def failed_row(config: dict[str, Any], trial: int, status: str, error: str) -> dict[str, Any]:
    """The row of a trial that has no results."""
    nothing = dict.fromkeys((*Metrics._fields, *Consistency._fields), float("nan"))
    return {
        **_labels(config, trial, status),
        **nothing,
        "collided": None,
        "steps": 0,
        "error": error,
    }


def _labels(config: dict[str, Any], trial: int, status: str) -> dict[str, Any]:
    own = {"trial": trial, "status": status}
    return own | {name: value for name, value in labels(config).items() if name not in own}


def _path_rows(trial: int, result: Trial) -> list[dict[str, Any]]:
    controls = np.vstack([result.controls, np.full_like(result.controls[:1], np.nan)])
    columns = zip(result.states, result.beliefs.mean, result.beliefs.cov, controls, strict=True)
    return [
        {"trial": trial, "step": k, "state": x, "mean": mean, "cov": cov.ravel(), "control": u}
        for k, (x, mean, cov, u) in enumerate(columns)
    ]
