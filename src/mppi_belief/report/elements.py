"""Builds what the sections share: tables and figures beside the page, and numbers in sentences."""

import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from ..errors import counted
from .cell_results import CellResults, differing_labels
from .drawing import drawn
from .figures.style import save_png_and_pdf
from .figures.trajectories import compare_paths, plane_panel
from .frame_files import write_frame
from .latex import escaped
from .page import PageTable, Picture
from .statistics import lowest_apart
from .summary import (
    BUSY_MARK,
    BUSY_NOTE,
    interval_text,
    summarise_trials,
    summary_numbers,
    summary_text,
)
from .wording import count_range, listed

COMPARED_METHODS = ("belief_joint", "belief", "ce", "ilqg")  # of pictures of paths, in this order


def cell_lines(cells: Sequence[CellResults]) -> pd.DataFrame:
    """Returns a line of text per cell, without the labels that have one value in all cells.

    A label is headed by the last part of its key where no other label ends alike.
    """
    lines = []
    for cell, labels in zip(cells, differing_labels(cells), strict=True):
        endings = [key.rpartition(".")[2] for key in labels]
        columns: dict[str, Any] = {}
        for ending, (key, value) in zip(endings, labels.items(), strict=True):
            heading = ending if endings.count(ending) == 1 else key
            columns[heading] = cell.name if key == "controller" else value
        lines.append(summary_text(cell.rows, columns, cell.seconds, cell.busy))
    return pd.DataFrame(lines).fillna("-")


def write_page_table(
    folder: Path,
    stem: str,
    caption: str,
    frame: pd.DataFrame,
    cells: Sequence[CellResults] | None = None,
) -> PageTable:
    """Writes a table of the page as STEM.md and STEM.csv, and returns it.

    The CSV file has the numbers of `cells` in full precision or, without cells, the text of
    `frame`. The caption explains the mark of times that were measured on a busy machine.
    """
    numbers = None
    if cells is not None:
        lines = [summary_numbers(cell.rows, cell.labels, cell.seconds) for cell in cells]
        numbers = pd.DataFrame(lines)
    write_frame(folder, stem, frame, numbers)
    if cells is not None and any_busy(cells):
        caption = f"{caption}. {BUSY_NOTE}"
    return PageTable(stem, caption, frame)


def write_picture(
    folder: Path, stem: str, draw: Callable[[], Figure | None], alt: str
) -> list[Picture]:
    """Writes the figure that `draw` returns as STEM.png and STEM.pdf.

    Returns no picture where there is no figure. Where it cannot be drawn or written, the page has a
    note in its place, and no files of an earlier report remain.
    """

    def write() -> list[Picture]:
        figure = draw()
        if figure is None:
            return []
        save_png_and_pdf(figure, folder, stem)
        return [Picture(f"{stem}.png", alt)]

    pictures = drawn(stem, write)
    if pictures is None:
        for kind in ("png", "pdf"):
            (folder / f"{stem}.{kind}").unlink(missing_ok=True)
        return [Picture(f"{stem}.png", alt)]
    return pictures


def bold_lowest_rate(table: PageTable, cells: Sequence[CellResults], column: str) -> PageTable:
    """Sets the lowest collision rate in bold where its interval lies below those of all others.

    `table` has a row per cell. The caption gains the rule where a rate is in bold.
    """
    rates = [summarise_trials(cell.rows, None).collided for cell in cells]
    index = lowest_apart(rates)
    if index is None:
        return table
    bold = [(index, list(table.frame.columns).index(column))]
    rule = "bold: a collision rate whose 95 % interval lies below the intervals of all others"
    return table._replace(bold=bold, caption=f"{table.caption}; {rule}")


def latex_time(cell: CellResults) -> str:
    """Returns the time of a step in ms with three digits, marked if busy; "--" without times."""
    milliseconds = summarise_trials(cell.rows, cell.seconds).time
    if math.isnan(milliseconds):
        return "--"
    text = f"{milliseconds:.0f}" if milliseconds >= 100 else f"{milliseconds:#.3g}"
    return f"{text}{BUSY_MARK}" if cell.busy else text


def machine_sentence(cells: Sequence[CellResults]) -> str:
    """Returns a sentence in LaTeX on the machines of the times; "" where none is known."""
    sources = itertools.chain.from_iterable(cell.sources for cell in cells)
    processors = {str(source["processor"]) for source in sources if source.get("processor")}
    busy = f" {BUSY_MARK}: while other work kept the machine busy." if any_busy(cells) else ""
    if not processors:
        return busy.strip()
    return f"Times measured here on {escaped(listed(sorted(processors)))}.{busy}"


def any_busy(cells: Sequence[CellResults]) -> bool:
    """Returns whether some times were measured while other work kept the machine busy."""
    return any(cell.busy and cell.seconds for cell in cells)


def collision_text(cell: CellResults) -> str:
    """Returns the collision rate with its interval, in %."""
    rate = summarise_trials(cell.rows, None).collided.times(100)
    return f"{interval_text(rate, 1)} %"


def cost_text(cell: CellResults) -> str:
    """Returns the mean cost with its interval."""
    return interval_text(summarise_trials(cell.rows, None).cost, 1)


def drawn_text(cells: Sequence[CellResults]) -> str:
    """Says how many trials of the cells a picture of all kept paths draws: "50 of 200 trials ..."

    Cells of which no path was kept have no panel and do not count.
    """
    pictured = [cell for cell in cells if len(cell.good_paths)]
    numbers = [cell.good_paths["trial"].nunique() for cell in pictured]
    good = [len(cell.good) for cell in pictured]
    verb = "is" if set(numbers) == {1} else "are"
    of_each = " of each panel" if len(pictured) > 1 else ""
    noun = counted(max(good, default=0), "trial").partition(" ")[2]
    return f"{count_range(numbers)} of {count_range(good)} {noun}{of_each} {verb} drawn"


def write_path_panels(
    folder: Path, stem: str, cells: Sequence[CellResults], titles: Sequence[str], caption: str
) -> list[Picture]:
    """Writes the paths of some cells in the plane, a panel with a title each.

    Cells without paths in the plane are left out. The number of drawn trials follows the caption.
    """

    def draw() -> Figure | None:
        panels = [plane_panel(cell, title) for cell, title in zip(cells, titles, strict=True)]
        shown = [panel for panel in panels if panel is not None]
        return compare_paths(shown) if shown else None

    return write_picture(folder, stem, draw, f"{caption}; {drawn_text(cells)}")


def write_paths_of_methods(folder: Path, stem: str, cells: Sequence[CellResults]) -> list[Picture]:
    """Writes the paths of the cells of `COMPARED_METHODS` in the plane, a panel each."""
    shown = [cell for cell in cells if cell.method in COMPARED_METHODS]
    shown.sort(key=lambda cell: COMPARED_METHODS.index(cell.method))
    names = [cell.name for cell in shown]
    return write_path_panels(folder, stem, shown, names, "Paths in the plane, a panel per method")
