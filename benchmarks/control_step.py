"""Time one control step of each controller: one process, one thread, one CPU, compiled and warm.

    python benchmarks/control_step.py [controller ...]

Rounds are interleaved, so that a drift of the machine meets all controllers alike. Writes
outputs/bench/control_step.json and prints a table.
"""

import json
import os
import platform
import resource
import sys
from datetime import UTC, datetime
from pathlib import Path

from mppi_belief.study import environment

environment.prepare()
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})

import numpy as np  # noqa: E402  the environment must be set before NumPy and JAX start

from mppi_belief.cli import collect  # noqa: E402
from mppi_belief.experiment import time_steps  # noqa: E402

ROUNDS, CALLS = 5, 60
DEFAULT = ["belief", "ce"]


def measure(controllers: list[str]) -> dict[str, list[float]]:
    """Seconds of ROUNDS x CALLS control steps for each controller."""
    configs = {name: collect([f"controller={name}"])[0] for name in controllers}
    times: dict[str, list[float]] = {name: [] for name in controllers}
    for _ in range(ROUNDS):
        for name, config in configs.items():
            times[name] += time_steps(config, CALLS)
    return times


def main() -> None:
    """Measure, write, print."""
    times = measure(sys.argv[1:] or DEFAULT)
    rows = [
        {
            "controller": name,
            "median_ms": 1e3 * float(np.median(seconds)),
            "p95_ms": 1e3 * float(np.quantile(seconds, 0.95)),
            "calls": len(seconds),
        }
        for name, seconds in times.items()
    ]
    report = {
        "measured": datetime.now(UTC).isoformat(timespec="seconds"),
        "platform": platform.platform(),
        "load": os.getloadavg(),
        "peak_memory_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "threads": environment.threads(),
        "rows": rows,
    }
    target = Path("outputs/bench/control_step.json")
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps(report, indent=1))
    print("| controller | median ms | p95 ms |\n|---|---|---|")
    for row in rows:
        print(f"| {row['controller']} | {row['median_ms']:.3f} | {row['p95_ms']:.3f} |")
    print(f"peak memory {report['peak_memory_mib']:.0f} MiB; written to {target}")


if __name__ == "__main__":
    main()
