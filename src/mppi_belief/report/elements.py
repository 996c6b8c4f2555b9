"""What sections are made of: tables and figures, written beside the page, and numbers in sentences."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from .cell_results import CellResults, differing_labels
from .figures import save_png_and_pdf
from .frame_files import write_frame
from .page import Picture, Table
from .summary import interval_text, summarise_trials, summary_numbers, summary_text


def cell_lines(founds: Sequence[CellResults]) -> pd.DataFrame:
    """A line of text a cell, without the labels that are the same for all that have one."""
    text = []
    for found, labels in zip(founds, differing_labels(founds), strict=True):
        ends = [name.rpartition(".")[2] for name in labels]
        shown: dict[str, Any] = {
            end if ends.count(end) == 1 else name: found.name if name == "controller" else value
            for end, (name, value) in zip(ends, labels.items(), strict=True)
        }
        text.append(summary_text(found.rows, shown, found.seconds))
    return pd.DataFrame(text).fillna("-")


def write_table(
    folder: Path,
    stem: str,
    caption: str,
    frame: pd.DataFrame,
    founds: Sequence[CellResults] | None = None,
) -> Table:
    """A table of the page, beside it as Markdown and as CSV: all numbers of `founds`, or else the same text."""
    machine = None
    if founds is not None:
        machine = pd.DataFrame(
            [summary_numbers(found.rows, found.labels, found.seconds) for found in founds]
        )
    write_frame(folder, stem, frame, machine)
    return Table(stem, caption, frame)


def write_picture(folder: Path, stem: str, figure: Figure | None, alt: str) -> list[Picture]:
    """A figure beside the page as PNG and PDF; none where there was nothing to draw."""
    if figure is None:
        return []
    save_png_and_pdf(figure, folder, stem)
    return [Picture(f"{stem}.png", alt)]


def collision_text(found: CellResults) -> str:
    """Collision rate and its interval, in %."""
    return f"{interval_text(summarise_trials(found.rows, None).collided.times(100), 1)} %"


def cost_text(found: CellResults) -> str:
    """Mean cost and its interval."""
    return interval_text(summarise_trials(found.rows, None).cost, 1)
