"""Prints how readable the code of a checkout is, in numbers, and checks the rules that CI enforces.

    python docs/scripts/style_report.py                       # the working tree
    python docs/scripts/style_report.py --before 18f6aef      # a commit beside the working tree
    python docs/scripts/style_report.py --list docstrings src/mppi_belief/cli   # each finding
    python docs/scripts/style_report.py --check [PATH...]     # exits with 1 if a rule is broken

A checkout is a folder or a git revision. Only the standard library is needed.
"""

import argparse
import io
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import style_measures as measures
from style_checkout import Finding, Module, modules

ROOT = Path(__file__).resolve().parents[2]
# Where the rules that CI enforces hold.
CHECKED_FOLDERS = ["src", "tests", "benchmarks", "experiments", "examples", "docs/scripts"]

# The measures that are lists of findings in the package, by the name that `--list` takes.
LISTS: dict[str, Callable[[list[Module]], list[Finding]]] = {
    "shared-names": measures.shared_names,
    "tuples": measures.tuple_assignments,
    "lines": measures.long_lines,
    "clauses": measures.clause_docstrings,
    "docstrings": measures.verbless_docstrings,
    "words": measures.private_words,
    "functions": measures.long_functions,
    "modules": measures.long_modules,
    "privates": measures.reached_privates,
}


@contextmanager
def checkout(source: str) -> Iterator[Path]:
    """Yields the folder of a checkout; a git revision is unpacked into a temporary folder."""
    if Path(source).is_dir():
        yield Path(source)
        return
    command = ["git", "-C", str(ROOT), "archive", source]
    archive = subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
            tar.extractall(folder, filter="data")
        yield Path(folder)


def table(root: Path) -> dict[str, str]:
    """Returns every measure of a checkout as text, by the sentence that describes it."""
    source = modules(root, "src")
    tests = modules(root, "tests")
    lines = measures.code_lines(source)
    tuples = len(measures.tuple_assignments(source))
    long_lines = len(measures.long_lines(source))
    functions = measures.function_lengths(source)
    shared = measures.shared_names(source)
    public_shared = [finding for finding in shared if not finding.text.startswith("`_")]
    lengths = sorted(len(module.lines) for module in source)
    return {
        "modules at the root of the package": str(len(measures.root_modules(root))),
        "names in the import rule": str(len(measures.import_rule_names(root))),
        "top-level names defined in two or more modules": str(len(shared)),
        "  of these public": str(len(public_shared)),
        "tuple-to-tuple assignments": str(tuples),
        "  per 1000 lines": f"{1000 * tuples / lines:.1f}",
        "lines over 100 characters": str(long_lines),
        "  per cent": f"{100 * long_lines / lines:.1f}",
        "docstrings of functions that open with a noun clause": str(
            len(measures.clause_docstrings(source))
        ),
        "docstrings that do not start with a verb": str(len(measures.verbless_docstrings(source))),
        "private words used as names": str(len(measures.private_words(source))),
        "private attributes that tests reach into": str(len(measures.reached_privates(tests))),
        "lines of src that are not blank": str(lines),
        "modules of src": str(len(source)),
        "median module, lines": str(lengths[len(lengths) // 2]),
        "longest module, lines": str(lengths[-1]),
        "modules over 200 lines": str(len(measures.long_modules(source))),
        "longest function, lines": str(functions[0]),
        "functions over 40 lines": str(sum(length > 40 for length in functions)),
        "full-line comments, per cent": f"{100 * measures.comment_lines(source) / lines:.1f}",
    }


def print_table(columns: dict[str, dict[str, str]]) -> None:
    """Prints one Markdown table with a column per checkout."""
    rows = next(iter(columns.values()))
    width = max(map(len, rows))
    print("| " + "measure".ljust(width) + " | " + " | ".join(columns) + " |")
    print(
        "|"
        + "-" * (width + 2)
        + "|"
        + "|".join("-" * (len(name) + 1) + ":" for name in columns)
        + "|"
    )
    for row in rows:
        cells = [column[row].rjust(len(name)) for name, column in columns.items()]
        print("| " + row.ljust(width) + " | " + " | ".join(cells) + " |")


def broken_rules(root: Path, folders: list[str]) -> list[Finding]:
    """Returns the findings against the rules that CI enforces, in order of file and line."""
    files = modules(root, *folders)
    return sorted(measures.tuple_assignments(files) + measures.private_words(files))


def main(arguments: list[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "paths", nargs="*", help="folders or files of the checkout to list or check"
    )
    parser.add_argument("--of", default=str(ROOT), help="the checkout: a folder or a git revision")
    parser.add_argument("--before", help="a checkout to compare with: a folder or a git revision")
    parser.add_argument("--list", choices=LISTS, help="print the findings of one measure")
    parser.add_argument("--check", action="store_true", help="fail if a rule is broken")
    parser.add_argument(
        "--report-only",
        action="store_true",
        help="with --check: print the number of findings and exit with 0",
    )
    options = parser.parse_args(arguments)
    with checkout(options.of) as root:
        if options.check:
            findings = broken_rules(root, options.paths or CHECKED_FOLDERS)
            for finding in [] if options.report_only else findings:
                print(finding)
            print(f"style: {len(findings)} broken rules", file=sys.stderr)
            return int(bool(findings) and not options.report_only)
        if options.list:
            default = ["tests"] if options.list == "privates" else ["src"]
            for finding in LISTS[options.list](modules(root, *(options.paths or default))):
                print(finding)
            return 0
        columns = {}
        if options.before:
            with checkout(options.before) as old:
                columns[options.before] = table(old)
        columns["now"] = table(root)
        print_table(columns)
    return 0


if __name__ == "__main__":
    sys.exit(main())
