"""Files written whole or not at all, with the same bytes for the same content."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd


def atomically(path: Path, write: Callable[[Path], Any]) -> None:
    """Let `write` fill a temporary file and put it in the place of `path`; nothing is left behind where it fails."""
    temporary = path.with_name(f".tmp-{os.getpid()}-{path.name}")
    try:
        write(temporary)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """A text file."""
    atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def write_frame(folder: Path, stem: str, text: pd.DataFrame, numbers: pd.DataFrame | None) -> None:
    """STEM.md from cells of text, STEM.csv from the numbers or, where there are none, from the same text."""
    write_text(folder / f"{stem}.md", as_markdown(text))
    write_text(folder / f"{stem}.csv", (text if numbers is None else numbers).to_csv(index=False))


def as_markdown(frame: pd.DataFrame) -> str:
    """A table of text in Markdown, bars in it escaped."""
    rows = [[str(name) for name in frame.columns], ["---"] * len(frame.columns)]
    rows += [[str(value).replace("|", r"\|") for value in row] for row in frame.itertuples(index=False)]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows) + "\n"
