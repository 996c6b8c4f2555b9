"""Writes text and tables atomically; the same content always gives the same bytes."""

from pathlib import Path

import pandas as pd

from ..results.files import write_whole


def write_text_file(path: Path, text: str) -> None:
    """Writes a text file, completely or not at all."""
    write_whole(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def write_frame(folder: Path, stem: str, text: pd.DataFrame, numbers: pd.DataFrame | None) -> None:
    """Writes STEM.md from cells of text, and STEM.csv from `numbers` or else from the text."""
    write_text_file(folder / f"{stem}.md", as_markdown(text))
    csv = (text if numbers is None else numbers).to_csv(index=False)
    write_text_file(folder / f"{stem}.csv", csv)


def as_markdown(frame: pd.DataFrame) -> str:
    """Returns a table of text in Markdown; bars within cells are escaped."""
    lines = [_markdown_line([str(name) for name in frame.columns])]
    lines.append(_markdown_line(["---"] * len(frame.columns)))
    for row in frame.itertuples(index=False):
        lines.append(_markdown_line([str(value).replace("|", r"\|") for value in row]))
    return "\n".join(lines) + "\n"


def _markdown_line(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"
