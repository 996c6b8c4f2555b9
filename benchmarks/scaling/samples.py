"""Measures what one more sample costs: the time of a control step and the peak memory of its
process.

Each number of samples has a process of its own, all on one CPU in interleaved rounds, as in `make
bench`.
"""

from pathlib import Path
from statistics import median
from typing import Any

import rounds
from mppi_belief.config.cache_folders import program_folder
from plant import WARM_UP
from remote import SubjectError
from table import summary
from workload import workload

from .processes import PYTHON, peak_mb, programs
from .sizes import Sizes

CONTROLLERS = {"ce": "CE-MPPI", "belief": "MPPI-Belief"}


def measure(sizes: Sizes, folder: Path) -> dict[str, Any]:
    """Returns for each controller rows over N, and how flat the cost of a sample-step is."""
    work = workload()
    names = [f"{controller}-{n}" for controller in CONTROLLERS for n in sizes.samples]
    cpu = rounds.one_cpu()
    subjects = {name: _start(name, cpu, folder) for name in names}
    try:
        for name in names:
            if _compiles(subjects[name], work):  # the compiler's memory is not the planner's
                subjects[name].end()
                subjects[name] = _start(name, cpu, folder)
        results = rounds.measure(
            subjects, work, "float32", sizes.sample_rounds, work["steps"] - WARM_UP
        )
        peaks = {
            name: peak_mb(subject.process.pid)
            for name, subject in subjects.items()
            if subject.process.poll() is None
        }
    finally:
        rounds.end(list(subjects.values()))
    numbers: dict[str, Any] = {"horizon": work["horizon"]}
    for controller in CONTROLLERS:
        rows = [
            _row(n, work["horizon"], f"{controller}-{n}", results, peaks) for n in sizes.samples
        ]
        good = [row for row in rows if "ns" in row]
        numbers[controller] = {
            "rows": rows,
            "spread": spread([row["ns"] for row in good]),
            "fixed_ms": fixed_ms(good),
        }
    return numbers


def _start(name: str, cpu: int, folder: Path) -> Any:
    """Starts the process of one controller and number of samples."""
    return rounds.start(PYTHON, "scaled", name, cpu, folder / f"{name}.txt")


def _compiles(subject: Any, work: dict[str, Any]) -> bool:
    """Makes a subject compile its program; returns whether it was not in the cache before."""
    before = _programs()
    try:
        subject.ask("prepare", workload=work, dtype="float32")
        subject.ask("time", calls=1)
    except SubjectError:  # told again, and kept, when it is measured
        return False
    return _programs() > before


def _programs() -> int:
    """Returns the number of compiled programs in the cache of this user."""
    folder = program_folder()
    return programs(folder) if folder else 0


def _row(
    n: int, horizon: int, name: str, results: dict[str, Any], peaks: dict[str, float]
) -> dict[str, Any]:
    """Returns the row of one number of samples."""
    row = summary(results[name])
    if "median_ms" not in row:
        return {"n": n, "error": row.get("error", "no times")}
    fastest = 1e3 * min(median(calls) for calls in results[name]["rounds"])
    times = {"median_ms": row["median_ms"], "p95_ms": row["p95_ms"], "fastest_round_ms": fastest}
    return {
        "n": n,
        **times,
        "ns": per_sample_step(row["median_ms"], n, horizon),
        "peak_mb": peaks[name],
    }


def per_sample_step(ms: float, n: int, horizon: int) -> float:
    """Returns the ns per step and sample of a control step that took `ms`."""
    return 1e6 * ms / (n * horizon)


def spread(values: list[float]) -> float | None:
    """Returns the ratio of the largest value to the smallest."""
    return max(values) / min(values) if values else None


def fixed_ms(rows: list[dict[str, Any]]) -> float | None:
    """Returns the ms of a control step that do not depend on the number of samples.

    It is the time with the fewest samples, less these samples at the price that they have among the
    most.
    """
    if not rows:
        return None
    few = rows[0]
    many = rows[-1]
    return few["median_ms"] - few["n"] * many["median_ms"] / many["n"]


def markdown(numbers: dict[str, Any]) -> str:
    """Returns a table over N with both controllers side by side."""
    lines = [
        f"**Cost of a sample-step**, {numbers['horizon']} steps ahead, float32, one thread: the "
        "median time of a step, the same divided by samples and steps, and the peak memory.",
        "",
        "| samples | "
        + " | ".join(f"{label} ms | ns | MB" for label in CONTROLLERS.values())
        + " |",
        "|---|" + "---|" * (3 * len(CONTROLLERS)),
    ]
    for rows in zip(*(numbers[name]["rows"] for name in CONTROLLERS), strict=True):
        lines.append(
            "| " + " | ".join([f"{rows[0]['n']:,}".replace(",", " "), *map(_cells, rows)]) + " |"
        )
    spreads, fixed = (
        ", ".join(f"{_number(numbers[name][key])} ({label})" for name, label in CONTROLLERS.items())
        for key in ("spread", "fixed_ms")
    )
    sentence = (
        f"Ratio of the most expensive sample-step to the cheapest: {spreads}. "
        f"Part of a step that does not depend on the samples, in ms: {fixed}."
    )
    return "\n".join([*lines, "", sentence])


def _number(value: float | None) -> str:
    """Returns a number as text."""
    return "unknown" if value is None else f"{value:.2f}"


def _cells(row: dict[str, Any]) -> str:
    """Returns the cells of one controller in a row of the table."""
    if "error" in row:
        return f"{row['error']} | | "
    return f"{row['median_ms']:.3f} | {row['ns']:.1f} | {row['peak_mb']:.0f}"
