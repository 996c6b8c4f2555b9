"""Where the numbers of a report come from, and what a reader should know before trusting them."""

from collections.abc import Iterable, Sequence
from typing import Any

from . import published
from .cell_results import CellResults


def trial_provenance(founds: Sequence[CellResults]) -> list[tuple[str, str]]:
    """What produced the trials: commit, versions, machine, seeds, commands, wall time; (what, value) pairs."""
    sources = [source for found in founds for source in found.sources]
    versions = [source.get("versions") or {} for source in sources]
    packages = sorted({name for one in versions for name in one})
    return [
        ("commit", _all(full_commit(source) for source in sources)),
        (
            "versions",
            ", ".join(f"{name} {_all(one.get(name) for one in versions)}" for name in packages),
        ),
        (
            "machine",
            _all(f"{source.get('processor')}, {source.get('platform')}" for source in sources),
        ),
        ("seeds", _all(found.labels["seed"] for found in founds)),
        ("device", _all(source["device"] for source in sources if source.get("device"))),
        ("precision", _all(found.cell.config["precision"] for found in founds)),
        ("trials", f"{sum(len(found.rows) for found in founds)} in {len(founds)} cells"),
        ("wall time", f"{_wall_time(sources) / 60:.1f} min of running trials"),
        ("commands", _all(" ".join(source.get("command") or []) for source in sources)),
    ]


def trial_warnings(founds: Sequence[CellResults]) -> list[str]:
    """What should keep a reader from trusting the numbers as they are; one line each."""
    sources = [source for found in founds for source in found.sources]
    lines = []
    for what, values in (
        ("commits", {full_commit(source) for source in sources}),
        (
            "versions of jaxlib",
            {(source.get("versions") or {}).get("jaxlib") for source in sources},
        ),
        ("devices", {source.get("device") for source in sources if source.get("device")}),
        ("algorithm versions", {source.get("algorithm") for source in sources}),
    ):
        if len(values) > 1:
            lines.append(f"The trials come from different {what}: {_all(values)}.")
    if any(source.get("dirty") for source in sources):
        lines.append("Some trials were run from a checkout with uncommitted changes.")
    few = [found for found in founds if found.wanted < published.TRIALS]
    if few:
        lines.append(
            f"{few[0].wanted} trials a cell are fewer than the paper's {published.TRIALS}: the intervals are wide."
        )
    missing = [found for found in founds if found.missing > 0]
    if missing:
        lines.append(
            f"{len(missing)} of {len(founds)} cells are incomplete: {sum(f.missing for f in missing)} trials missing."
        )
    failed = sum(len(found.rows) - len(found.good) for found in founds)
    if failed:
        lines.append(f"{failed} trials failed and are left out of every average.")
    return lines


def full_commit(source: dict[str, Any]) -> str:
    """The commit that made something, or the installed version."""
    head = source.get("commit")
    if head is None:
        return f"installed package {(source.get('versions') or {}).get('mppi-belief', 'of unknown version')}"
    return f"{head}{' with changes' if source.get('dirty') else ''}"


def _all(values: Iterable[Any]) -> str:
    """Every distinct value once, in order."""
    return "; ".join(sorted({str(value) for value in values})) or "-"


def _wall_time(sources: Sequence[dict[str, Any]]) -> float:
    """Seconds from the start of each run to its last trial, over all runs."""
    runs: dict[tuple[str, str], float] = {}
    for source in sources:
        run = str(source.get("started")), str(source.get("command"))
        runs[run] = max(runs.get(run, 0.0), float(source.get("elapsed") or 0.0))
    return sum(runs.values())
