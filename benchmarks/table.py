"""From seconds to the Markdown table."""

from statistics import median, quantiles
from typing import Any

from contestants import CONTESTANTS, KINDS

REACHED = 1.0  # m: the goal counts as reached where a trial, from 6.4 m away, comes this near
DTYPES = ("float32", "float64")


def summary(result: dict[str, Any]) -> dict[str, Any]:
    """Median, 95 % quantile (ms), number of calls, of the rounds of one contestant; its rounds left out."""
    seconds = [s for calls in result["rounds"] for s in calls]
    kept = {key: value for key, value in result.items() if key != "rounds"}
    if "error" in result or len(seconds) < 2:
        return kept
    p95 = quantiles(seconds, n=20, method="inclusive")[-1]
    medians = [1e3 * median(calls) for calls in result["rounds"]]
    return kept | {
        "median_ms": 1e3 * median(seconds),
        "p95_ms": 1e3 * p95,
        "calls": len(seconds),
        "round_medians_ms": medians,
    }


def ratio(rows: dict[str, dict[str, Any]], name: str, to: str | None) -> float | None:
    """Median of one by the median of the other; None where one is missing."""
    a, b = (rows.get(one, {}).get("median_ms") for one in (name, to))
    return None if a is None or b is None else a / b


def markdown(report: dict[str, Any]) -> str:
    """The tables, one for each precision, and under them what could not be measured."""
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
    lines = [
        "| | median ms | p95 ms | ratio to ours | multiple of its floor | nearest to goal m | reached |",
        "|---|---|---|---|---|---|---|",
    ]
    for kind, title in KINDS.items():
        own = [one for one in CONTESTANTS if one.kind == kind and one.name in rows]
        lines += [f"| **{title}** | | | | | | |"] if own else []
        for one in sorted(
            own,
            key=lambda one: rows[one.name].get("median_ms", float("inf")) if kind == "peers" else 0,
        ):
            row = rows[one.name]
            near = row.get("nearest")
            cells = [
                one.label,
                _number(row.get("median_ms"), ".3f") if "error" not in row else "failed",
                _number(row.get("p95_ms"), ".3f"),
                _number(ratio(rows, one.name, one.beside), ".2f"),
                _number(ratio(rows, one.name, one.floor), ".2f"),
                _number(near, ".2f"),
                "" if near is None else "yes" if near <= REACHED else "no",
            ]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def origin(report: dict[str, Any]) -> str:
    """When it was measured, at which commit, on which machine."""
    changed = " (changed)" if report["dirty"] else ""
    commit = f"{report['commit'] or 'unknown'}{changed}"
    return f"{report['started']}, commit {commit}; {report['processor']}, {report['platform']}"


def _machine(report: dict[str, Any]) -> str:
    """Where and when: date, commit, machine, load; how each was set up, with versions."""
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
            *(f"- {', '.join(labels)}: {said}" for said, labels in setups.items()),
        ]
    )


def _label(name: str) -> str:
    return next(one.label for one in CONTESTANTS if one.name == name)


def _number(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)
