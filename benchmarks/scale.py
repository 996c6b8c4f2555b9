"""Measures throughput and scale: whole studies, many samples, long runs, wide sweeps, start-up.

    python benchmarks/scale.py [PART ...] [--quick] [--docs]

PART is one of table_1 samples long_run sweep start_up; without one all are measured, in about
twelve minutes. Writes outputs/bench/scale.json and .md, where parts that are not run keep what they
had, and prints the tables; `--docs` writes docs/benchmarks_more.md too. `--quick` runs a little of
each, to see that it works, and writes nothing.
"""

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import rounds
from document import write_between
from environments import ROOT
from mppi_belief.results.provenance import provenance
from remote import SubjectError
from scaling import long_run, samples, start_up, sweep, table_1
from scaling.processes import CommandError
from scaling.sizes import QUICK, Sizes

PARTS: dict[str, ModuleType] = {
    "table_1": table_1,
    "samples": samples,
    "long_run": long_run,
    "sweep": sweep,
    "start_up": start_up,
}
OUTPUT = ROOT / "outputs" / "bench"


def main(argv: list[str] | None = None) -> None:
    """Measures the chosen parts, writes and prints; exits with 1 if a part failed."""
    options = options_of(argv, PARTS, __doc__ or "")
    report: dict[str, Any] = {} if options.quick else _stored()
    for name in options.parts or PARTS:
        report[name] = measured(PARTS[name], QUICK if options.quick else Sizes())
        if not options.quick:
            _write(report)
    text = markdown(report)
    if options.docs:
        write_between("scale", text)
    print(text)
    sys.exit(any("error" in part for part in report.values()))


def options_of(argv: list[str] | None, known: Mapping[str, Any], about: str) -> argparse.Namespace:
    """Returns the parsed arguments: which of the known parts are to run, and how."""
    parser = argparse.ArgumentParser(description=about.partition("\n")[0])
    parser.add_argument(
        "parts", nargs="*", metavar="PART", help=f"of {' '.join(known)}; all without one"
    )
    only = parser.add_mutually_exclusive_group()
    only.add_argument(
        "--quick", action="store_true", help="a little of everything, nothing written"
    )
    only.add_argument("--docs", action="store_true", help="write the page in docs/ too")
    options = parser.parse_args(argv)
    for name in options.parts:
        if name not in known:
            parser.error(f"{name}: not one of {', '.join(known)}")
    return options


def measured(part: Any, sizes: Sizes) -> dict[str, Any]:
    """Returns the numbers of one part, or the reason why there are none, and their source."""
    source_keys = ("started", "commit", "dirty", "processor", "platform", "versions")
    source = {key: value for key, value in provenance(sys.argv).items() if key in source_keys}
    part_report: dict[str, Any] = {"source": source | {"load": os.getloadavg()}}
    OUTPUT.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(
        dir=OUTPUT, prefix="scale-"
    ) as folder:  # the disk that results go to
        try:
            part_report["numbers"] = part.measure(sizes, Path(folder))
        except (CommandError, SubjectError) as error:
            part_report["error"] = str(error)
            rounds.say(f"{error}")
    return part_report


def markdown(report: dict[str, Any], known: Mapping[str, Any] | None = None) -> str:
    """Returns the tables of all parts, what failed, and when and where they were measured."""
    known = PARTS if known is None else known
    shown = [name for name in known if name in report]
    parts = [
        known[name].markdown(report[name]["numbers"]) for name in shown if "numbers" in report[name]
    ]
    parts += [
        f"Not measured: {name} ({report[name]['error']})"
        for name in shown
        if "error" in report[name]
    ]
    return "\n\n".join([*parts, "\n".join(_source(name, report[name]["source"]) for name in shown)])


def _source(name: str, source: dict[str, Any]) -> str:
    """Returns a line that says when and where a part was measured."""
    load = ", ".join(f"{value:.2f}" for value in source["load"])
    commit = f"{(source['commit'] or 'unknown')[:12]}{' (changed)' if source['dirty'] else ''}"
    machine = f"{source['processor']}, {source['platform']}, jax {source['versions']['jax']}"
    return (
        f"- `{name}`: {source['started']}, commit {commit}, {machine}, load average before {load}"
    )


def _stored() -> dict[str, Any]:
    """Returns the report that an earlier call wrote; an empty one without it."""
    try:
        stored: dict[str, Any] = json.loads((OUTPUT / "scale.json").read_text())
    except (OSError, ValueError):
        return {}
    return stored


def _write(report: dict[str, Any]) -> None:
    """Writes the report as JSON and as Markdown."""
    (OUTPUT / "scale.json").write_text(json.dumps(report, indent=1))
    (OUTPUT / "scale.md").write_text(markdown(report) + "\n")


if __name__ == "__main__":
    main()
