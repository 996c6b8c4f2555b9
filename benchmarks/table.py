"""Turns seconds into the Markdown table of docs/benchmarks.md."""

from statistics import median, quantiles
from typing import Any

from contestants import CONTESTANTS, KINDS

REACHED = 1.0  # m: the goal counts as reached where a trial, from 6.4 m away, comes this near
DTYPES = ("float32", "float64")


def summary(result: dict[str, Any]) -> dict[str, Any]:
    """Returns median and 95 % quantile in ms and the number of calls of one contestant.

    The seconds of its rounds are left out.
    """
    seconds = [s for calls in result["rounds"] for s in calls]
    values = {key: value for key, value in result.items() if key != "rounds"}
    if "error" in result or len(seconds) < 2:
        return values
    p95 = quantiles(seconds, n=20, method="inclusive")[-1]
    medians = [1e3 * median(calls) for calls in result["rounds"]]
    return values | {
        "median_ms": 1e3 * median(seconds),
        "p95_ms": 1e3 * p95,
        "calls": len(seconds),
        "round_medians_ms": medians,
    }


def ratio(rows: dict[str, dict[str, Any]], name: str, to: str | None) -> float | None:
    """Returns the median of one row divided by that of another; None where one is missing."""
    a, b = (rows.get(contestant, {}).get("median_ms") for contestant in (name, to))
    return None if a is None or b is None else a / b


def markdown(report: dict[str, Any]) -> str:
    """Returns the tables, one per precision, and below them what could not be measured."""
    parts = []
    for dtype in DTYPES:
        rows = report["rows"].get(dtype, {})
        if rows:
            parts.append(f"### {dtype}\n\n{_table(rows)}")
    failures = [
        f"- {_label(name)} ({dtype}): {row['error']}"
        for dtype, rows in report["rows"].items()
        for name, row in rows.items()
        if "error" in row
    ]
    if failures:
        parts.append("Not measured:\n\n" + "\n".join(failures))
    return "\n\n".join([*parts, _machine(report)])


def _table(rows: dict[str, dict[str, Any]]) -> str:
    """Returns the table of one precision."""
    lines = [
        "| | median ms | p95 ms | ratio to ours | multiple of its floor | nearest to goal m "
        "| reached |",
        "|---|---|---|---|---|---|---|",
    ]
    for kind, title in KINDS.items():
        own = [
            contestant
            for contestant in CONTESTANTS
            if contestant.kind == kind and contestant.name in rows
        ]
        lines += [f"| **{title}** | | | | | | |"] if own else []
        for contestant in sorted(
            own,
            key=lambda contestant: (
                rows[contestant.name].get("median_ms", float("inf")) if kind == "peers" else 0
            ),
        ):
            row = rows[contestant.name]
            near = row.get("nearest")
            cells = [
                contestant.label,
                _number(row.get("median_ms"), ".3f") if "error" not in row else "failed",
                _number(row.get("p95_ms"), ".3f"),
                _number(ratio(rows, contestant.name, contestant.beside), ".2f"),
                _number(ratio(rows, contestant.name, contestant.floor), ".2f"),
                _number(near, ".2f"),
                "" if near is None else "yes" if near <= REACHED else "no",
            ]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def origin(report: dict[str, Any]) -> str:
    """Returns when a report was measured, at which commit and on which machine."""
    changed = " (changed)" if report["dirty"] else ""
    commit = f"{report['commit'] or 'unknown'}{changed}"
    return f"{report['started']}, commit {commit}; {report['processor']}, {report['platform']}"


def _machine(report: dict[str, Any]) -> str:
    """Returns when and where a report was measured, and how each contestant was set up."""
    setups: dict[str, list[str]] = {}
    for row_name, row in {
        name: row for rows in report["rows"].values() for name, row in rows.items()
    }.items():
        if "versions" in row:
            packages = ", ".join(
                f"{package} {number}" for package, number in row["versions"].items()
            )
            setups.setdefault(f"{row['settings']}; {packages}", []).append(_label(row_name))
    load = ", ".join(f"{value:.2f}" for value in report["load"])
    return "\n".join(
        [
            f"{origin(report)}; load average before the first round {load}; "
            f"{report['rounds']} rounds of {report['calls']} calls, one thread on one CPU.",
            "",
            *(f"- {', '.join(labels)}: {setup}" for setup, labels in setups.items()),
        ]
    )


def _label(name: str) -> str:
    """Returns the label of a contestant."""
    return next(contestant.label for contestant in CONTESTANTS if contestant.name == name)


def _number(value: float | None, form: str) -> str:
    """Returns a number as text; an empty text for None."""
    return "" if value is None else format(value, form)
