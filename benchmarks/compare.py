"""Compares the working tree with a commit: our controllers, interleaved round by round on one CPU.

    python benchmarks/compare.py COMMIT [NAME ...] [--rounds N] [--calls N] [--dtype D]

Prints for each controller the two medians and the ratio of the working tree's to the commit's,
below 1 where the working tree is faster: the median of the rounds' ratios with its 95 % bootstrap
interval. Nothing is asserted. Each tree is measured by the benchmark program of its own, so that
commits with another package interface can be compared.
"""

import argparse
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import rounds
from contestants import CONTESTANTS, Contestant, choose
from environments import ROOT
from table import DTYPES, summary
from workload import workload

RESAMPLES = 10_000
HERE = "working tree"
THERE = "commit"


def main(argv: list[str] | None = None) -> None:
    """Unpacks the commit, measures both trees and prints a line per controller."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("commit", help="any word git takes for a commit")
    parser.add_argument(
        "names", nargs="*", help="our controllers and floors; the controllers without one"
    )
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--calls", type=int, default=60, help="in each round")
    parser.add_argument("--dtype", action="append", choices=DTYPES, help="float32 without it")
    options = parser.parse_args(argv)
    chosen = choose(
        options.names or ["ours"],
        [contestant for contestant in CONTESTANTS if contestant.environment is None],
    )
    with tempfile.TemporaryDirectory(prefix="mppi-belief-") as folder:
        unpack(options.commit, Path(folder))
        trees = {HERE: ROOT, THERE: Path(folder)}
        print(f"{'':16}{HERE + ' ms':>16}{options.commit[:12] + ' ms':>16}   ratio [95 %]")
        for dtype in options.dtype or DTYPES[:1]:
            results = _measure(chosen, trees, dtype, options.rounds, options.calls)
            for contestant in chosen:
                print(
                    line(
                        contestant.name,
                        dtype,
                        *(results[f"{contestant.name} {tree}"] for tree in trees),
                    )
                )


def unpack(commit: str, folder: Path) -> None:
    """Unpacks a commit into `folder`; ends the program with one line if there is no such commit."""
    archive = folder / "tree.tar"
    command = [
        "git",
        "-C",
        str(ROOT),
        "archive",
        "--output",
        str(archive),
        commit,
        "src",
        "conf",
        "benchmarks",
        "pyproject.toml",
    ]
    archived = subprocess.run(command, capture_output=True, text=True, check=False)
    if archived.returncode:
        raise SystemExit(f"{commit}: {archived.stderr.strip().splitlines()[-1]}")
    with tarfile.open(archive) as files:
        files.extractall(folder, filter="data")
    code = "import mppi_belief; print(mppi_belief.__file__)"
    env = environment_of(folder)
    imported_from = subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True
    ).stdout
    if not Path(imported_from.strip()).resolve().is_relative_to(folder.resolve()):
        raise SystemExit(
            f"the package of {commit} is hidden by {imported_from.strip()}: "
            "install this checkout with pip -e"
        )


def environment_of(tree: Path) -> dict[str, str]:
    """Returns the environment variables that make a process import the package of a tree."""
    return {"PYTHONPATH": str(tree / "src")}


def _measure(
    chosen: Sequence[Contestant], trees: dict[str, Path], dtype: str, n_rounds: int, calls: int
) -> dict[str, dict[str, Any]]:
    """Measures every contestant in both trees; returns the results by contestant and tree."""
    subjects = {
        f"{contestant.name} {tree}": rounds.start(
            sys.executable,
            contestant.module,
            contestant.name,
            rounds.one_cpu(),
            ROOT
            / "outputs"
            / "bench"
            / "logs"
            / f"{contestant.name}-{dtype}-{tree.replace(' ', '-')}.txt",
            environment_of(path),
            path / "benchmarks" / "subject.py",
        )
        for contestant in chosen
        for tree, path in trees.items()
    }
    try:
        return rounds.measure(subjects, workload(), dtype, n_rounds, calls)
    finally:
        rounds.end(list(subjects.values()))


def line(name: str, dtype: str, here: dict[str, Any], there: dict[str, Any]) -> str:
    """Returns one line of the printed table."""
    label = f"{name} {dtype[5:]}"
    for tree, result in ((HERE, here), (THERE, there)):
        if "error" in result:
            return f"{label:16}{tree}: {result['error']}"
    a, b = (summary(result)["median_ms"] for result in (here, there))
    middle, low, high = ratio_interval(here["rounds"], there["rounds"])
    return f"{label:16}{a:16.3f}{b:16.3f}   {middle:.3f} [{low:.3f}, {high:.3f}]"


def ratio_interval(
    here: list[list[float]], there: list[list[float]], seed: int = 0
) -> tuple[float, float, float]:
    """Returns the median of the rounds' ratios of medians and its 95 % bootstrap interval."""
    ratios = np.array([np.median(a) / np.median(b) for a, b in zip(here, there, strict=True)])
    drawn = np.random.default_rng(seed).choice(ratios, (RESAMPLES, len(ratios)))
    low, high = np.quantile(np.median(drawn, axis=1), [0.025, 0.975])
    return float(np.median(ratios)), float(low), float(high)


if __name__ == "__main__":
    main()
