"""Builds what the sections share: tables and figures beside the page, and numbers in sentences."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from .cell_results import CellResults, differing_labels
from .drawing import drawn
from .figures.style import save_png_and_pdf
from .figures.trajectories import PathPanel, compare_paths, plane_panel
from .frame_files import write_frame
from .page import PageTable, Picture
from .summary import BUSY_NOTE, interval_text, summarise_trials, summary_numbers, summary_text

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
    if cells is not None and any(cell.busy and cell.seconds for cell in cells):
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


def collision_text(cell: CellResults) -> str:
    """Returns the collision rate with its interval, in %."""
    rate = summarise_trials(cell.rows, None).collided.times(100)
    return f"{interval_text(rate, 1)} %"


def cost_text(cell: CellResults) -> str:
    """Returns the mean cost with its interval."""
    return interval_text(summarise_trials(cell.rows, None).cost, 1)


def write_path_panels(
    folder: Path, stem: str, panels: Callable[[], Sequence[PathPanel | None]], alt: str
) -> list[Picture]:
    """Writes the paths of several cells in the plane, a panel each; skips panels that are None."""

    def draw() -> Figure | None:
        shown = [panel for panel in panels() if panel is not None]
        return compare_paths(shown) if shown else None

    return write_picture(folder, stem, draw, alt)


def write_paths_of_methods(
    folder: Path, stem: str, cells: Sequence[CellResults], alt: str
) -> list[Picture]:
    """Writes the paths of the cells of `COMPARED_METHODS` in the plane, a panel each."""
    shown = [cell for cell in cells if cell.method in COMPARED_METHODS]
    shown.sort(key=lambda cell: COMPARED_METHODS.index(cell.method))
    return write_path_panels(
        folder, stem, lambda: [plane_panel(cell, cell.name) for cell in shown], alt
    )
