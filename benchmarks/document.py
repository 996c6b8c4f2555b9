"""The measured parts of docs/benchmarks.md and docs/cluster.md, each between two markers of its own."""

from pathlib import Path

from environments import ROOT

DOCS = ROOT / "docs" / "benchmarks.md"
END = "<!-- end -->"


def write_between(name: str, text: str, page: Path | None = None) -> None:
    """Put `text` where docs/benchmarks.md, or another page, has the measured part `name`."""
    page = page or DOCS
    page.write_text(between(page.read_text(), name, text))


def between(document: str, name: str, text: str) -> str:
    """The document with `text` between the marker of `name` and the next end."""
    start = f"<!-- measured: {name} -->"
    head, found, rest = document.partition(start)
    if not found:
        raise SystemExit(f"{DOCS.name} has no line {start}")
    old, ended, tail = rest.partition(END)
    if not ended or "<!-- measured:" in old:
        raise SystemExit(f"{DOCS.name}: what was measured after {start} does not end with {END}")
    return f"{head}{start}\n\n{text}\n\n{END}{tail}"
