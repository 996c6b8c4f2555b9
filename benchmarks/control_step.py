"""Times one control step of ours beside every MPPI library, on the work of Sec. VII.

    python benchmarks/control_step.py [NAME ...] [--rounds N] [--calls N] [--dtype D] [--docs]

Each contestant has one process, one thread and one CPU. NAME is a contestant, a kind (ours, floors,
peers) or an environment, see `contestants`; without one all are measured. Writes
outputs/bench/control_step.json and .md and prints the table; `--docs` writes docs/benchmarks.md
too.
"""

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

import environments
import rounds
from contestants import Contestant, choose
from document import write_between
from mppi_belief.config import environment
from mppi_belief.results.provenance import provenance
from table import DTYPES, markdown, summary
from workload import workload

OUTPUT = environments.ROOT / "outputs" / "bench"


def main(argv: list[str] | None = None) -> None:
    """Installs the peers, measures, writes the report and prints its table."""
    options = _options(argv)
    chosen = choose(options.names)
    pythons, reasons = interpreters(chosen)
    report = {
        **{
            key: value
            for key, value in provenance(sys.argv).items()
            if key not in ("threads", "algorithm")
        },
        "load": os.getloadavg(),
        "rounds": options.rounds,
        "calls": options.calls,
        "workload": workload(),
        "rows": {},
    }
    for dtype in options.dtype or DTYPES:
        runners = [contestant for contestant in chosen if dtype in contestant.dtypes]
        report["rows"][dtype] = measure_precision(runners, pythons, reasons, report, dtype)
        _write(report)
    text = markdown(report)
    if options.docs:
        write_between("control_step", text)
    print(text)


def _options(argv: list[str] | None) -> argparse.Namespace:
    """Returns the parsed arguments."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "names", nargs="*", help="contestants, kinds or environments; all without one"
    )
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument(
        "--calls", type=int, default=55, help="in each round; with the warm-up just one trial"
    )
    parser.add_argument(
        "--dtype", action="append", choices=DTYPES, help="float32 or float64; both without it"
    )
    parser.add_argument("--docs", action="store_true", help="write docs/benchmarks.md too")
    return parser.parse_args(argv)


def interpreters(chosen: list[Contestant]) -> tuple[dict[str | None, Path], dict[str | None, str]]:
    """Returns the interpreter of each environment, and the reason for each that has none."""
    pythons: dict[str | None, Path] = {None: Path(sys.executable)}
    reasons: dict[str | None, str] = {}
    for name in dict.fromkeys(
        contestant.environment for contestant in chosen if contestant.environment
    ):
        try:
            pythons[name] = environments.python(name)
        except environments.CannotInstallError as error:
            reasons[name] = str(error)
            rounds.say(f"{name}: {error}")
    return pythons, reasons


def measure_precision(
    runners: list[Contestant],
    pythons: dict[str | None, Path],
    reasons: dict[str | None, str],
    report: dict[str, Any],
    dtype: str,
) -> dict[str, dict[str, Any]]:
    """Returns the rows of one precision; a contestant that is not installed has its reason."""
    ready = [contestant for contestant in runners if contestant.environment in pythons]
    threads = threads_of_peers()
    subjects = {
        contestant.name: rounds.start(
            pythons[contestant.environment],
            contestant.module,
            contestant.name,
            rounds.one_cpu(),
            OUTPUT / "logs" / f"{contestant.name}-{dtype}.txt",
            threads if contestant.environment else None,
        )
        for contestant in ready
    }
    try:
        measured = rounds.measure(
            subjects, report["workload"], dtype, report["rounds"], report["calls"]
        )
    finally:
        rounds.end(list(subjects.values()))
    missing = {
        contestant.name: {"error": reasons[contestant.environment]}
        for contestant in runners
        if contestant.environment in reasons
    }
    return {name: summary(result) for name, result in measured.items()} | missing


def threads_of_peers() -> dict[str, str]:
    """Returns environment variables: one thread for each library, and the XLA flags of ours."""
    before = dict(os.environ)
    try:
        environment.prepare()
        return environment.threads() | environment.numeric_settings() | {"JAX_PLATFORMS": "cpu"}
    finally:
        os.environ.clear()
        os.environ.update(before)


def _write(report: dict[str, Any]) -> None:
    """Writes the report as JSON and as Markdown."""
    OUTPUT.mkdir(parents=True, exist_ok=True)
    (OUTPUT / "control_step.json").write_text(json.dumps(report, indent=1))
    (OUTPUT / "control_step.md").write_text(markdown(report) + "\n")


if __name__ == "__main__":
    main()
