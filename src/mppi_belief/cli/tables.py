"""What `mppi-belief results` says of cells: one line each, or all of one."""

from collections.abc import Sequence
from typing import Any

import pandas as pd
from omegaconf import OmegaConf

from ..report.summary import aligned_text, label_text, summary_text
from ..results.contents import CellContents, identifying_settings, status_counts, superseded
from ..results.folder import cell_files, seconds_since_write, total_size
from ..results.sources import runs
from ..results.trial_ranges import ranges_in_words

ALWAYS = ("theta", "w_obs", "seed")  # other settings are shown where they differ


def listing(cells: Sequence[CellContents]) -> str:
    """A table with a line for each cell: rows by status, settings, files, size, age, commit, algorithm."""
    rows = [contents.rows for contents in cells]
    ended = [status_counts(one) for one in rows]
    statuses = dict.fromkeys(
        status for one in sorted(ended, key=lambda one: "ok" not in one) for status in one
    )
    told = [
        {name: label_text(value) for name, value in identifying_settings(contents).items()}
        for contents in cells
    ]
    lines = []
    for contents, count, labels in zip(cells, ended, told, strict=True):
        there = cell_files(contents.folder)
        line = {"cell": contents.folder.name} | {
            status: str(count.get(status, "-")) for status in statuses
        }
        line |= {name: labels.get(name, "-") for name in _telling(told)}
        line |= {
            "files": str(len(there)),
            "size": bytes_in_words(total_size(there)),
            "age": time_in_words(seconds_since_write(there)),
        }
        line |= {"commit": _all(short_commit(source) for source in contents.sources)}
        line |= {"algorithm": _all(source.get("algorithm", "-") for source in contents.sources)}
        lines.append(line | {"note": _note(contents)})
    if not any(line["note"] for line in lines):
        for line in lines:
            del line["note"]
    return aligned_text(lines)


def _telling(told: Sequence[dict[str, str]]) -> list[str]:
    """The settings to show: some always, the others where there is more than one value; the id has the controller."""
    names = dict.fromkeys(name for one in told for name in one)
    differ = [name for name in names if len({one[name] for one in told if name in one}) > 1]
    return [name for name in names if name != "controller" and (name in ALWAYS or name in differ)]


def _note(contents: CellContents) -> str:
    """What keeps a cell from being like the others."""
    old = superseded(contents)
    notes = [f"superseded: {old}"] if old else []
    notes += [f"{len(contents.problems)} unreadable"] if contents.problems else []
    return "; ".join(notes)


def description(contents: CellContents) -> str:
    """All that is known of one cell: configuration, runs, statuses, a summary, files."""
    rows = contents.rows
    note = _note(contents)
    parts = [contents.folder.name + (f" ({note})" if note else "")]
    parts.append(
        OmegaConf.to_yaml(OmegaConf.create(contents.config)).rstrip()
        if contents.config
        else "no configuration"
    )
    parts += [_run(source) for source in runs(contents, rows)]
    parts.append("\n".join([*_statuses(rows)] or ["no rows"]))
    labels = {
        name: value
        for name, value in identifying_settings(contents).items()
        if name in ("controller", *ALWAYS)
    }
    if len(rows):
        parts.append(aligned_text([summary_text(rows, labels, _seconds(contents))]))
    width = max((len(path.name) for path in cell_files(contents.folder)), default=0)
    parts.append(
        "\n".join(
            f"{path.name:{width}}  {bytes_in_words(total_size([path]))}"
            for path in cell_files(contents.folder)
        )
    )
    return "\n\n".join(parts)


def _run(source: dict[str, Any]) -> str:
    """A run and its trials, a few lines."""
    words = [str(word) for word in source.get("command") or []]
    versions = source.get("versions") or {}
    lines = {
        "trials": ranges_in_words(source["trials"]) if source.get("trials") else "-",
        "command": " ".join(words) or "-",
        "started": source.get("started", "-"),
        "commit": short_commit(source, short=False),
        "algorithm": source.get("algorithm", "-"),
        "machine": ", ".join(
            str(source[name]) for name in ("device", "processor", "platform") if source.get(name)
        ),
        "versions": ", ".join(f"{name} {version}" for name, version in versions.items()),
    }
    return "\n".join(f"{name:9}  {value}" for name, value in lines.items())


def _statuses(rows: pd.DataFrame) -> list[str]:
    """How many trials ended how, with an example of each kind that went wrong."""
    lines = []
    for status, count in status_counts(rows).items():
        first = rows[rows["status"] == status].iloc[0]
        lines.append(
            f"{count} {status}"
            + ("" if status == "ok" else f", e.g. trial {first['trial']}: {first['error']}")
        )
    return lines


def _seconds(contents: CellContents) -> list[float]:
    found = contents.notes.get("timing", {}).get("seconds")
    return found if isinstance(found, list) else []


def short_commit(source: dict[str, Any], short: bool = True) -> str:
    """The commit that made something, `+` if it had changes; the version of an installed package."""
    head = source.get("commit")
    if not head:
        return str((source.get("versions") or {}).get("mppi-belief", "-"))
    return f"{str(head)[: 7 if short else None]}{'+' if source.get('dirty') else ''}"


def _all(values: Any, most: int = 3) -> str:
    """Every distinct value once, in order; of many the first ones."""
    found = list(dict.fromkeys(str(value) for value in values))
    return ",".join(found[:most]) + (",..." if len(found) > most else "") or "-"


def bytes_in_words(number: int) -> str:
    """A size as people read it, in powers of ten: "1.2 MB"."""
    value = float(number)
    for unit in ("B", "kB", "MB", "GB"):
        if value < 999.5 or unit == "GB":
            break
        value /= 1000
    return f"{value:.0f} {unit}" if unit == "B" or value >= 99.5 else f"{value:.1f} {unit}"


def time_in_words(seconds: float) -> str:
    """A time as people read it: "12 min"."""
    for length, unit in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"
