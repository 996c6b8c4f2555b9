"""Measures what antithetic pairs gain: the error of a control step against the number of samples.

    python benchmarks/variance.py [--keys N] [--docs]

The same beliefs and nominals of one closed-loop trial are given to planners with other keys. The
error is that of the first control against the limit of many samples, so it includes the bias of the
weights. Times are measured as by `make bench`. Writes outputs/bench/variance.json and .md; `--docs`
writes docs/benchmarks_more.md too.
"""

import argparse
import json
from dataclasses import replace
from typing import Any, NamedTuple

from mppi_belief.config import environment

environment.prepare()

import jax  # the environment must be set before JAX starts
import numpy as np
from jax import Array

from document import write_between
from environments import ROOT
from mppi_belief import MPPI
from mppi_belief.config.compose import collect
from mppi_belief.config.request import Request
from mppi_belief.numerics.jax_settings import pin_jax_settings
from mppi_belief.simulate import closed_loop
from mppi_belief.trial import CellParts, build, time_steps

# JAX keeps the dispatch that it starts with, so this precedes the first computation.
pin_jax_settings()

SAMPLES = (50, 150, 500, 1500, 5000)
STEPS = range(0, 30, 3)  # of the trial: the obstacles are passed in its first 3 s
LIMIT = 50_000, 16  # samples and keys whose mean control counts as the limit
SEED = 0


class Noted(NamedTuple):
    """Holds a planner's diagnostics and its arguments."""

    ess: Array  # ()
    arguments: "Moment"


class Moment(NamedTuple):
    """Holds the arguments of the planner at some steps of a trial, stacked."""

    beliefs: Any  # the belief, every array with the steps first
    plans: Array  # nominals (steps, H, nu)


def main(argv: list[str] | None = None) -> None:
    """Measures both controllers, writes the rows and prints the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--keys", type=int, default=200)
    parser.add_argument("--docs", action="store_true", help="write docs/benchmarks_more.md too")
    options = parser.parse_args(argv)
    rows = [row for name in ("belief", "ce") for row in measure(name, options.keys)]
    folder = ROOT / "outputs" / "bench"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "variance.json").write_text(json.dumps(rows, indent=1))
    text = markdown(rows, options.keys)
    (folder / "variance.md").write_text(text + "\n")
    if options.docs:
        write_between("variance", text)
    print(text)


def measure(name: str, n_keys: int) -> list[dict[str, Any]]:
    """Returns a row per number of samples: RMS error of u (m/s^2) and ms per step.

    Both are measured with plain samples and with mirrored ones.
    """
    (config,) = collect(Request((f"controller={name}",)))
    parts = build(config)
    moment_stack = moments(parts)
    exact = controls(parts, moment_stack, LIMIT[0], False, LIMIT[1], SEED + 1).mean(
        axis=1, keepdims=True
    )
    rows = []
    for n in SAMPLES:
        row: dict[str, Any] = {"controller": name, "n_samples": n}
        squares = {}
        for label, mirrored in (("plain", "false"), ("mirrored", "true")):
            errors = controls(parts, moment_stack, n, mirrored == "true", n_keys, SEED) - exact
            squares[label] = np.mean(np.sum(errors**2, axis=-1), axis=0)
            overrides = [
                f"controller={name}",
                f"planner.n_samples={n}",
                f"controller.sampler.antithetic={mirrored}",
            ]
            seconds = time_steps(collect(Request(tuple(overrides)))[0], 200)
            row[label] = {
                "rmse": float(np.sqrt(squares[label].mean())),
                "ms": 1e3 * float(np.median(seconds)),
            }
        row["ratio"] = ratio(squares["mirrored"], squares["plain"])
        rows.append(row)
    return rows


def ratio(a: np.ndarray, b: np.ndarray) -> list[float]:
    """Returns mean(a) / mean(b) and its 95 % bootstrap interval.

    The bootstrap draws from the keys (n,) that both share.
    """
    picks = np.random.default_rng(SEED).integers(len(a), size=(2000, len(a)))
    low, high = np.quantile(a[picks].mean(axis=1) / b[picks].mean(axis=1), [0.025, 0.975])
    return [float(a.mean() / b.mean()), float(low), float(high)]


def moments(parts: CellParts) -> Moment:
    """Returns the arguments of the planner as configured at `STEPS` of trial 0."""
    problem, filter, controller = parts

    def act(problem: Any, belief: Any, plan: Array, key: Array) -> Any:
        u, after, info = controller.act(problem, belief, plan, key)
        return u, after, Noted(info.ess, Moment(belief, plan))

    planner = type(
        "Planner", (), {"init": staticmethod(controller.init), "act": staticmethod(act)}
    )()
    moment_stack = jax.jit(
        lambda: closed_loop(problem, filter, planner, SEED, 0, lambda info: info.arguments)[1]
    )()
    return jax.tree.map(lambda a: a[np.array(STEPS)], moment_stack)


def controls(
    parts: CellParts, moment_stack: Moment, n: int, mirrored: bool, n_keys: int, seed: int
) -> np.ndarray:
    """Returns the first controls (steps, keys, nu)."""
    sampler = replace(parts.controller.sampler, antithetic=mirrored)
    planner: MPPI = replace(parts.controller, n_samples=n, sampler=sampler)
    keys = jax.random.split(jax.random.key(seed), n_keys)

    @jax.jit
    def first(moment: Moment) -> Array:
        return jax.lax.map(
            lambda key: planner.act(parts.problem, moment.beliefs, moment.plans, key)[0], keys
        )

    steps = [jax.tree.map(lambda a, k=k: a[k], moment_stack) for k in range(len(STEPS))]
    return np.stack([np.asarray(first(moment), dtype=float) for moment in steps])


def markdown(rows: list[dict[str, Any]], n_keys: int) -> str:
    """Returns the table."""
    lines = [
        "| | N | error m/s² | with pairs | ratio of squares [95 %] | ms | with pairs |",
        "|---|---|---|---|---|---|---|",
    ]
    names = {"belief": "MPPI-Belief", "ce": "CE-MPPI"}
    for row in rows:
        plain = row["plain"]
        mirrored = row["mirrored"]
        middle, low, high = row["ratio"]
        lines.append(
            f"| {names[row['controller']]} | {row['n_samples']} | {plain['rmse']:.3f} "
            f"| {mirrored['rmse']:.3f} | {middle:.2f} [{low:.2f}, {high:.2f}] "
            f"| {plain['ms']:.3f} | {mirrored['ms']:.3f} |"
        )
    return "\n".join([*lines, "", f"{n_keys} keys at each of {len(STEPS)} steps of one trial."])


if __name__ == "__main__":
    main()
