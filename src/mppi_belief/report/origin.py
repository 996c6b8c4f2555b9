"""Reports the provenance of the trials, and what keeps a reader from trusting their numbers."""

import itertools
import json
import shlex
from collections.abc import Iterable, Sequence
from typing import Any

from ..errors import counted
from . import published
from .cell_results import CellResults


def trial_provenance(cells: Sequence[CellResults]) -> list[tuple[str, str]]:
    """Returns names and values: commit, versions, machine, seeds, commands, wall time, ..."""
    sources = _all_sources(cells)
    versions = [source.get("versions") or {} for source in sources]
    packages = sorted(set().union(*versions))
    package_versions = [
        f"{name} {_distinct(packages.get(name) for packages in versions)}" for name in packages
    ]
    machines = [f"{source.get('processor')}, {source.get('platform')}" for source in sources]
    devices = [source["device"] for source in sources if source.get("device")]
    trials = sum(len(cell.rows) for cell in cells)
    return [
        ("commit", _distinct(full_commit(source) for source in sources)),
        ("versions", ", ".join(package_versions)),
        ("machine", _distinct(machines)),
        ("seeds", _distinct(cell.labels["seed"] for cell in cells)),
        ("device", _distinct(devices)),
        ("precision", _distinct(cell.config["precision"] for cell in cells)),
        ("trials", f"{trials} in {counted(len(cells), 'cell')}"),
        ("wall time", f"{_wall_time(sources) / 60:.1f} min of running trials"),
        (
            "commands",
            _distinct(shlex.join(map(str, source.get("command") or [])) for source in sources),
        ),
    ]


def trial_warnings(cells: Sequence[CellResults]) -> list[str]:
    """Returns one line per reason not to trust the numbers as they are."""
    sources = _all_sources(cells)
    lines = []

    # Trials that do not belong together.
    origins: dict[str, set[Any]] = {
        "commits": {full_commit(source) for source in sources},
        "versions of jaxlib": {(source.get("versions") or {}).get("jaxlib") for source in sources},
        "devices": {source.get("device") for source in sources if source.get("device")},
        "settings": {
            json.dumps(source["settings"], sort_keys=True)
            for source in sources
            if "settings" in source
        },
        "algorithm versions": {source.get("algorithm") for source in sources},
    }
    for name, values in origins.items():
        if len(values) > 1:
            lines.append(f"The trials come from different {name}: {_distinct(values)}.")
    if any(source.get("dirty") for source in sources):
        lines.append("Some trials were run from a checkout with uncommitted changes.")

    # Too few trials.
    papers = [cell for cell in cells if cell.departures is not None]
    small = [cell.wanted for cell in papers if cell.wanted < published.PAPER_TRIALS]
    if small:
        lines.append(
            f"The report asks for {counted(min(small), 'trial')} per cell, the paper has "
            f"{published.PAPER_TRIALS}: the intervals are wide."
        )
    incomplete = [cell for cell in cells if cell.missing > 0]
    if incomplete:
        missing = sum(cell.missing for cell in incomplete)
        share = f"{len(incomplete)} of {counted(len(cells), 'cell')}"
        lines.append(
            f"{share} {'is' if len(incomplete) == 1 else 'are'} incomplete: "
            f"{counted(missing, 'trial')} {'is' if missing == 1 else 'are'} missing."
        )
    failed = sum(len(cell.rows) - len(cell.good) for cell in cells)
    if failed:
        lines.append(f"{counted(failed, 'trial')} failed; no average includes such a trial.")
    return lines


def full_commit(source: dict[str, Any]) -> str:
    """Returns the commit of a provenance or, without one, the version of the installed package."""
    commit = source.get("commit")
    if commit is None:
        version = (source.get("versions") or {}).get("mppi-belief", "of unknown version")
        return f"installed package {version}"
    return f"{commit}{' with changes' if source.get('dirty') else ''}"


def _all_sources(cells: Sequence[CellResults]) -> list[dict[str, Any]]:
    """Returns the provenance of every file that holds a row of the cells."""
    return list(itertools.chain.from_iterable(cell.sources for cell in cells))


def _distinct(values: Iterable[Any]) -> str:
    """Returns every distinct value once, sorted."""
    return "; ".join(sorted({str(value) for value in values})) or "-"


def _wall_time(sources: Sequence[dict[str, Any]]) -> float:
    """Returns the seconds from the start of each run to its last trial, summed over all runs."""
    runs: dict[tuple[str, str], float] = {}
    for source in sources:
        run = (str(source.get("started")), str(source.get("command")))
        runs[run] = max(runs.get(run, 0.0), float(source.get("elapsed") or 0.0))
    return sum(runs.values())
