"""Describes cells as text for `mppi-belief results`: a line per cell, or one cell in full."""

import shlex
from collections.abc import Iterable, Sequence
from typing import Any

import pandas as pd
from omegaconf import OmegaConf

from ..report.summary import BUSY_NOTE, aligned_text, label_text, summary_text
from ..results.contents import CellContents, identifying_settings, status_counts, superseded
from ..results.folder import cell_files, seconds_since_write, total_size
from ..results.sources import runs
from ..results.timing_load import measured_busy
from ..results.trial_ranges import ranges_in_words

ALWAYS_SHOWN = ("theta", "w_obs", "seed")  # other settings are shown where cells differ in them
MOST_LISTED = 3  # distinct values that a field lists before it ends with "..."


def listing(cells: Sequence[CellContents]) -> str:
    """Returns a table with a line per cell.

    The columns are the numbers of rows by status, settings, files, size, age, commit, algorithm
    and, if any cell has one, a note.
    """
    counts = [status_counts(contents.rows) for contents in cells]
    settings = [
        {name: label_text(value) for name, value in identifying_settings(contents).items()}
        for contents in cells
    ]
    statuses = _statuses_in_order(counts)
    shown = _shown_settings(settings)

    lines = []
    for contents, count, labels in zip(cells, counts, settings, strict=True):
        files = cell_files(contents.folder)
        algorithms = (source.get("algorithm", "-") for source in contents.sources)
        line = {"cell": contents.folder.name}
        line |= {status: str(count.get(status, "-")) for status in statuses}
        line |= {name: labels.get(name, "-") for name in shown}
        line["files"] = str(len(files))
        line["size"] = bytes_in_words(total_size(files))
        line["age"] = time_in_words(seconds_since_write(files))
        line["commit"] = _distinct_values(commit_label(source) for source in contents.sources)
        line["algorithm"] = _distinct_values(algorithms)
        line["note"] = _note(contents)
        lines.append(line)

    if not any(line["note"] for line in lines):
        for line in lines:
            del line["note"]
    return aligned_text(lines)


def _statuses_in_order(counts: Sequence[dict[str, int]]) -> list[str]:
    """Returns every status that occurs, those of cells with successful trials first."""
    statuses: dict[str, None] = {}
    for count in sorted(counts, key=lambda count: "ok" not in count):
        statuses |= dict.fromkeys(count)
    return [*statuses]


def _shown_settings(settings: Sequence[dict[str, str]]) -> list[str]:
    """Returns the names of `ALWAYS_SHOWN` and of settings with several values.

    The controller is left out, since it is part of a cell's name.
    """
    values: dict[str, set[str]] = {}
    for labels in settings:
        for name, value in labels.items():
            values.setdefault(name, set()).add(value)
    shown = [name for name in values if name in ALWAYS_SHOWN or len(values[name]) > 1]
    return [name for name in shown if name != "controller"]


def _note(contents: CellContents) -> str:
    """Says what distinguishes a cell from a complete and current one."""
    notes = []
    reason = superseded(contents)
    if reason:
        notes.append(f"superseded: {reason}")
    if contents.problems:
        notes.append(f"{len(contents.problems)} unreadable")
    return "; ".join(notes)


def description(contents: CellContents) -> str:
    """Returns everything about one cell: configuration, runs, statuses, a summary, files."""
    rows = contents.rows
    note = _note(contents)
    parts = [contents.folder.name + (f" ({note})" if note else "")]
    if contents.config:
        parts.append(OmegaConf.to_yaml(OmegaConf.create(contents.config)).rstrip())
    else:
        parts.append("no configuration")
    parts.extend(_run_text(source) for source in runs(contents, rows))
    parts.append("\n".join(_status_lines(rows)) or "no rows")
    if len(rows):
        settings = identifying_settings(contents)
        names = [name for name in settings if name in ("controller", *ALWAYS_SHOWN)]
        labels = {name: settings[name] for name in names}
        timing = contents.notes.get("timing", {})
        busy = measured_busy(timing)
        parts.append(aligned_text([summary_text(rows, labels, _step_times(timing), busy)]))
        parts += [BUSY_NOTE] if busy else []
    parts.append(_file_list(contents))
    return "\n\n".join(parts)


def _run_text(source: dict[str, Any]) -> str:
    """Returns a run and its trials in a few lines."""
    words = map(str, source.get("command") or [])
    versions = source.get("versions") or {}
    machine = [source.get(name) for name in ("device", "processor", "platform")]
    lines = {
        "trials": ranges_in_words(source["trials"]) if source.get("trials") else "-",
        "command": shlex.join(words) or "-",
        "started": source.get("started", "-"),
        "commit": commit_label(source, short=False),
        "algorithm": source.get("algorithm", "-"),
        "machine": ", ".join(str(part) for part in machine if part),
        "versions": ", ".join(f"{name} {version}" for name, version in versions.items()),
    }
    return "\n".join(f"{name:9}  {value}" for name, value in lines.items())


def _status_lines(rows: pd.DataFrame) -> list[str]:
    """Returns a line per status: how many trials ended so and, for failures, the first of them."""
    lines = []
    for status, count in status_counts(rows).items():
        line = f"{count} {status}"
        if status != "ok":
            first = rows[rows["status"] == status].iloc[0]
            line += f", e.g. trial {first['trial']}: {first['error']}"
        lines.append(line)
    return lines


def _file_list(contents: CellContents) -> str:
    """Returns a line per file with its size."""
    files = cell_files(contents.folder)
    width = max((len(path.name) for path in files), default=0)
    return "\n".join(f"{path.name:{width}}  {bytes_in_words(total_size([path]))}" for path in files)


def _step_times(timing: dict[str, Any]) -> list[float]:
    """Returns the wall times (s) of single control steps; none where the file holds no list."""
    seconds = timing.get("seconds")
    return seconds if isinstance(seconds, list) else []


def commit_label(source: dict[str, Any], short: bool = True) -> str:
    """Returns the commit of a provenance, with `+` for uncommitted changes.

    Without a commit, returns the version of the installed package.
    """
    commit = source.get("commit")
    if not commit:
        return str((source.get("versions") or {}).get("mppi-belief", "-"))
    return f"{str(commit)[: 7 if short else None]}{'+' if source.get('dirty') else ''}"


def _distinct_values(values: Iterable[Any]) -> str:
    """Returns every distinct value once, in order, at most `MOST_LISTED` of them."""
    distinct = list(dict.fromkeys(str(value) for value in values))
    ending = ",..." if len(distinct) > MOST_LISTED else ""
    return ",".join(distinct[:MOST_LISTED]) + ending or "-"


def bytes_in_words(number: int) -> str:
    """Returns a size in powers of ten, as "1.2 MB"."""
    value = float(number)
    for unit in ("B", "kB", "MB", "GB"):
        if value < 999.5 or unit == "GB":
            break
        value /= 1000
    return f"{value:.0f} {unit}" if unit == "B" or value >= 99.5 else f"{value:.1f} {unit}"


def time_in_words(seconds: float) -> str:
    """Returns a time in its largest unit, as "12 min"."""
    for length, unit in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"
