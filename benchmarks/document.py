"""Writes measured parts of the pages in docs/ between their markers."""

from pathlib import Path

from environments import ROOT

# The page of each measured part.
PAGES = {
    "control_step": ROOT / "docs" / "benchmarks.md",
    "beyond": ROOT / "docs" / "benchmarks_more.md",
    "variance": ROOT / "docs" / "benchmarks_more.md",
    "scale": ROOT / "docs" / "benchmarks_more.md",
    "cluster": ROOT / "docs" / "cluster.md",
}
END = "<!-- end -->"


def write_between(name: str, text: str, page: Path | None = None) -> None:
    """Replaces the measured part `name` of its page, or of another page, by `text`."""
    page = page or PAGES[name]
    page.write_text(between(page.read_text(), name, text))


def between(document: str, name: str, text: str) -> str:
    """Returns the document with `text` between the marker of `name` and the next end marker.

    Raises `SystemExit` if either marker is missing.
    """
    start = f"<!-- measured: {name} -->"
    head, marker, rest = document.partition(start)
    if not marker:
        raise SystemExit(f"the page has no line {start}")
    old, end_marker, tail = rest.partition(END)
    if not end_marker or "<!-- measured:" in old:
        raise SystemExit(f"the measured part after {start} does not end with {END}")
    return f"{head}{start}\n\n{text}\n\n{END}{tail}"
