"""From a cell's configuration to rows: the trials a worker runs.

A cell's configuration is a plain dict: what each of its parts is built from, the `names` chosen for them, a
`seed`, a `precision`, and what was `swept`. It is all a worker gets, so a row depends on nothing else.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from ..problem import Controller, Filter, Problem
from ..settings import labels
from ..simulate import Metrics, Trial, metrics, simulate_trial
from .build import build
from .scene import describe_scene

KEPT_PATHS = 50  # trajectories are kept for the first so many trials, for figures


class Batch(NamedTuple):
    """Results of some trials: one row each, one path row per step of each kept trial, the scene they ran in."""

    rows: list[dict[str, Any]]
    paths: list[dict[str, Any]]
    scene: dict[str, Any] | None


@jax.jit
def _run(problem: Problem, filter: Filter, controller: Controller, seed: Any, trial: Any) -> tuple[Metrics, Trial]:
    result = simulate_trial(problem, filter, controller, seed, trial)
    return metrics(problem, result), result


def run_trials(config: dict[str, Any], trials: Sequence[int]) -> Batch:
    """Run some trials of a cell, one after the other; an exception in one becomes its row's status."""
    rows, paths = [], []
    with jax.enable_x64(config["precision"] == "float64"):
        parts = build(config)
        for trial in trials:
            try:
                judged, result = jax.device_get(_run(*parts, config["seed"], trial))
            except Exception as error:
                rows.append(failed_row(config, trial, "error", f"{type(error).__name__}: {error}"))
                continue
            rows.append(_row(config, trial, judged, result))
            if trial < KEPT_PATHS:
                paths += _path_rows(trial, result)
        scene = describe_scene(parts.problem) if paths else None
    return Batch(rows, paths, scene)


def _row(config: dict[str, Any], trial: int, judged: Metrics, result: Trial) -> dict[str, Any]:
    values = {name: value.item() for name, value in judged._asdict().items()}
    finite = bool(np.all(np.isfinite(result.states)) and np.isfinite(values["cost"]))
    status, error = ("ok", None) if finite else ("diverged", "the state or the cost left the finite numbers")
    return {**_labels(config, trial, status), **values, "steps": len(result.controls), "error": error}


def failed_row(config: dict[str, Any], trial: int, status: str, error: str) -> dict[str, Any]:
    """The row of a trial that has no results."""
    nothing = dict.fromkeys(Metrics._fields, float("nan"))
    return {**_labels(config, trial, status), **nothing, "collided": None, "steps": 0, "error": error}


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
