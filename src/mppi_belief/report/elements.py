"""What sections are made of: tables and figures, written beside the page, and numbers in sentences."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from .cell_results import Found, differing
from .figures import save_both
from .files import write_frame
from .page import Picture, Table
from .summary import interval, numbers, summarise, summary


def lines(founds: Sequence[Found]) -> pd.DataFrame:
    """A line of text a cell, without the labels that are the same for all that have one."""
    text = []
    for found, labels in zip(founds, differing(founds), strict=True):
        ends = [name.rpartition(".")[2] for name in labels]
        shown: dict[str, Any] = {
            end if ends.count(end) == 1 else name: found.name if name == "controller" else value
            for end, (name, value) in zip(ends, labels.items(), strict=True)
        }
        text.append(summarise(found.rows, shown, found.seconds))
    return pd.DataFrame(text).fillna("-")


def table(
    folder: Path,
    stem: str,
    caption: str,
    frame: pd.DataFrame,
    founds: Sequence[Found] | None = None,
) -> Table:
    """A table of the page, beside it as Markdown and as CSV: all numbers of `founds`, or else the same text."""
    machine = None
    if founds is not None:
        machine = pd.DataFrame(
            [numbers(found.rows, found.labels, found.seconds) for found in founds]
        )
    write_frame(folder, stem, frame, machine)
    return Table(stem, caption, frame)


def picture(folder: Path, stem: str, figure: Figure | None, alt: str) -> list[Picture]:
    """A figure beside the page as PNG and PDF; none where there was nothing to draw."""
    if figure is None:
        return []
    save_both(figure, folder, stem)
    return [Picture(f"{stem}.png", alt)]


def rate(found: Found) -> str:
    """Collision rate and its interval, in %."""
    return f"{interval(summary(found.rows, None).collided.times(100), 1)} %"


def cost(found: Found) -> str:
    """Mean cost and its interval."""
    return interval(summary(found.rows, None).cost, 1)
