"""Times what goes beyond the paper: a control step, or an update of a filter, beside its standard.

    python benchmarks/beyond.py [--rounds N] [--docs]

All programs are compiled first, on one CPU with one thread. Then they take turns, one trial of 60
steps per round. Ratios are those of the medians of one run. Writes outputs/bench/beyond.json and
.md; `--docs` writes docs/benchmarks_more.md too.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from statistics import median
from typing import Any, NamedTuple

from mppi_belief.config import environment

environment.prepare()

import jax  # the environment must be set before JAX starts

from document import write_between
from environments import ROOT
from mppi_belief.belief.prior import draw_start
from mppi_belief.config.compose import collect
from mppi_belief.config.request import Request
from mppi_belief.numerics.jax_settings import pin_jax_settings
from mppi_belief.results.provenance import provenance
from mppi_belief.simulate import (
    FILTER,
    INITIAL_DRAW,
    PLANNER,
    PLANT,
    controller_belief,
    role_key,
    step_plant_and_filter,
)
from mppi_belief.trial import build
from rounds import one_cpu, say
from table import origin

# JAX keeps the dispatch that it starts with, so this precedes the first computation.
pin_jax_settings()

STEPS = 60
BELIEF = "controller=belief"
GUIDED = "controller/sampler=laplace"


class Row(NamedTuple):
    """Represents a configuration that is timed and the row that it is compared with."""

    name: str
    what: str  # "step": of the controller, "update": of the filter
    overrides: tuple[str, ...]  # of the command line
    beside: str  # the row it is compared with; its own name: none


ROWS = (
    Row("MPPI-Belief", "step", (BELIEF,), "MPPI-Belief"),
    Row("a covariance a path", "step", ("controller=belief_joint",), "MPPI-Belief"),
    Row("Laplace proposal", "step", (BELIEF, GUIDED), "MPPI-Belief"),
    Row(
        "Laplace proposal, N = 50", "step", (BELIEF, GUIDED, "planner.n_samples=50"), "MPPI-Belief"
    ),
    Row("two lanes, one Gaussian", "step", ("system=two_lanes", BELIEF), "two lanes, one Gaussian"),
    Row(
        "two lanes, mixture",
        "step",
        ("system=two_lanes", "filter=mixture", BELIEF),
        "two lanes, one Gaussian",
    ),
    Row(
        "sensor fixed", "step", ("system=steered", BELIEF, "system.selector=fixed"), "sensor fixed"
    ),
    Row(
        "sensor chosen",
        "step",
        ("system=steered", BELIEF, "system.selector=matched"),
        "sensor fixed",
    ),
    Row("beacons", "step", ("system=beacons", BELIEF), "beacons"),
    Row("pendulum", "step", ("system=pendulum", BELIEF), "pendulum"),
    Row("EKF, beacons", "update", ("system=beacons",), "EKF, beacons"),
    Row("UKF, beacons", "update", ("system=beacons", "filter=ukf"), "EKF, beacons"),
    Row("EKF, two lanes", "update", ("system=two_lanes",), "EKF, two lanes"),
    Row("mixture, two lanes", "update", ("system=two_lanes", "filter=mixture"), "EKF, two lanes"),
    Row(
        "EKF, sensor fixed",
        "update",
        ("system=steered", "system.selector=fixed"),
        "EKF, sensor fixed",
    ),
    Row(
        "EKF, sensor chosen",
        "update",
        ("system=steered", "system.selector=matched"),
        "EKF, sensor fixed",
    ),
)


def main(argv: list[str] | None = None) -> None:
    """Measures all rows, writes the report and prints its table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--docs", action="store_true", help="write docs/benchmarks_more.md too")
    options = parser.parse_args(argv)
    os.sched_setaffinity(0, {one_cpu()})
    report = {
        **{
            key: value
            for key, value in provenance(sys.argv).items()
            if key not in ("threads", "algorithm")
        },
        "load": os.getloadavg(),
        "rounds": options.rounds,
        "milliseconds": {
            name: 1e3 * median(seconds) for name, seconds in measure(options.rounds).items()
        },
    }
    folder = ROOT / "outputs" / "bench"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "beyond.json").write_text(json.dumps(report, indent=1))
    text = markdown(report)
    (folder / "beyond.md").write_text(text + "\n")
    if options.docs:
        write_between("beyond", text)
    print(text)


def measure(rounds: int) -> dict[str, list[float]]:
    """Returns the seconds of every call by the name of its row; the rows take turns."""
    calls = {}
    for row in ROWS:
        calls[row.name] = subject(row)
        say(f"{row.name}: compiled")
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            for step in range(STEPS):
                started = time.perf_counter()
                call(step)
                seconds[name].append(time.perf_counter() - started)
    return seconds


def subject(row: Row) -> Callable[[int], None]:
    """Returns the compiled call of a row, which computes step k of a trial and waits for it."""
    (config,) = collect(Request((*row.overrides, f"problem.steps={STEPS}")))
    parts = build(config)
    act = jax.jit(
        lambda parts, belief, plan, key: _step_result(
            *parts.controller.act(parts.problem, belief, plan, key)
        )
    )
    update = jax.jit(
        lambda parts, belief, u, y, key: parts.filter.update(parts.problem, belief, u, y, key)
    )
    answer = jax.jit(
        lambda parts, x, belief, u, k: step_plant_and_filter(
            parts.problem, parts.filter, x, belief, u, plant, filtering, k
        )
    )
    plant, filtering, planning = (role_key(0, 0, role) for role in (PLANT, FILTER, PLANNER))
    x, problem = draw_start(parts.problem, jax.random.fold_in(plant, INITIAL_DRAW))
    parts = parts._replace(problem=problem)
    belief = parts.filter.init(parts.problem, jax.random.fold_in(filtering, INITIAL_DRAW))
    plan = parts.controller.init(parts.problem)
    arguments = []
    for k in range(STEPS):
        key = jax.random.fold_in(planning, k)
        planned_from = controller_belief(parts.controller, belief, x)
        u, next_plan, _ = act(parts, planned_from, plan, key)
        x, y, next_belief = answer(parts, x, belief, u, k)
        arguments.append((planned_from, plan, key) if row.what == "step" else (belief, u, y, key))
        plan = next_plan
        belief = next_belief
    function = act if row.what == "step" else update

    def call(k: int) -> None:
        jax.block_until_ready(function(parts, *arguments[k]))

    call(0)
    return call


def _step_result(u: Any, plan: Any, info: Any) -> tuple[Any, Any, Any]:
    """Returns what a run keeps of a control step; a program need not return the rest."""
    return u, plan, info.ess


def markdown(report: dict[str, Any]) -> str:
    """Returns the table, and below it when and where it was measured."""
    milliseconds = report["milliseconds"]
    lines = ["| | what | ms | ratio to |", "|---|---|---|---|"]
    for row in ROWS:
        ratio = (
            f"{milliseconds[row.name] / milliseconds[row.beside]:.2f} {row.beside}"
            if row.beside != row.name
            else ""
        )
        lines.append(f"| {row.name} | {row.what} | {milliseconds[row.name]:.3f} | {ratio} |")
    load = ", ".join(f"{value:.2f}" for value in report["load"])
    lines += [
        "",
        f"{origin(report)}; load average before {load}; "
        f"{report['rounds']} rounds of {STEPS} calls, float32, one thread on one CPU.",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
