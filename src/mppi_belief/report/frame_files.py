"""Files written whole or not at all, with the same bytes for the same content."""

from pathlib import Path

import pandas as pd

from ..results.files import write_whole


def write_text_file(path: Path, text: str) -> None:
    """A text file."""
    write_whole(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def write_frame(folder: Path, stem: str, text: pd.DataFrame, numbers: pd.DataFrame | None) -> None:
    """STEM.md from cells of text, STEM.csv from the numbers or, where there are none, from the same text."""
    write_text_file(folder / f"{stem}.md", as_markdown(text))
    write_text_file(
        folder / f"{stem}.csv", (text if numbers is None else numbers).to_csv(index=False)
    )


def as_markdown(frame: pd.DataFrame) -> str:
    """A table of text in Markdown, bars in it escaped."""
    rows = [[str(name) for name in frame.columns], ["---"] * len(frame.columns)]
    rows += [
        [str(value).replace("|", r"\|") for value in row] for row in frame.itertuples(index=False)
    ]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows) + "\n"
