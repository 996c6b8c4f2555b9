"""A study or sweep of any problem: its cells, the differences between them, the swept keys."""

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from ...errors import counted
from ..cell_results import CellResults, cell_titles, differing_labels
from ..comparison import baseline_pairs, difference_frame, multiplicity_text
from ..elements import (
    bold_lowest_rate,
    cell_lines,
    latex_time,
    machine_sentence,
    write_page_table,
    write_path_panels,
    write_picture,
)
from ..figures.swept_keys import cells_figure, swept_figure, swept_numbers
from ..frame_files import write_text_file
from ..latex import LatexTable, escaped, plus_minus, render_latex
from ..page import Picture, Section
from ..summary import interval_text, summarise_trials

MOST_PATH_PANELS = 12  # of one picture; further cells have their paths in their own folders
RATE_COLUMN = "collided % [95 %]"


class OwnStudy(NamedTuple):
    """Holds a study that the report knows nothing of but its cells."""

    stem: str  # of its files: STEM.csv, STEM.md, STEM.tex, ...
    title: str
    cells: list[CellResults]


def own_study_section(study: OwnStudy, folder: Path, title: str) -> Section:
    """Builds the section `title`: all cells, paired differences, pictures; writes its files."""
    cells = study.cells
    write_text_file(folder / f"{study.stem}.tex", own_study_latex(study))
    caption = f"{counted(len(cells), 'cell')}; intervals are at 95 %, each by itself"
    table = write_page_table(folder, study.stem, caption, cell_lines(cells), cells)
    tables = [bold_lowest_rate(table, cells, RATE_COLUMN)]

    # The differences to a baseline.
    pairs = baseline_pairs([cell for cell in cells if len(cell.good)])
    if pairs:
        frame = difference_frame(pairs)
        caption = f"Differences to a baseline on common random numbers; {multiplicity_text(frame)}"
        write_text_file(folder / f"{study.stem}_differences.tex", differences_latex(study, frame))
        tables.append(write_page_table(folder, f"{study.stem}_differences", caption, frame))
    text = [
        "A difference is that of a cell to its baseline, trial by trial: trials of one number meet "
        "the same noise. The baseline is the first cell that differs in the controller alone, or "
        "else the first cell of the same system and seed."
    ]
    return Section(title, text if pairs else [], tables, _pictures(study, folder))


def _pictures(study: OwnStudy, folder: Path) -> list[Picture]:
    """Draws the swept keys, or the cells where no number is swept, and the paths in the plane."""
    cells = study.cells
    pictures = []
    for key in swept_numbers(cells):
        stem = f"{study.stem}_by_{key.rpartition('.')[2]}"
        having = sum(labels[key] != "-" for labels in differing_labels(cells))
        alt = f"Cost, and collisions where there are obstacles, over `{key}`, with 95 % intervals"
        if having < len(cells):
            alt += f"; {having} of {counted(len(cells), 'cell')} have this key"
        pictures += write_picture(folder, stem, partial(swept_figure, cells, key), alt)
    if not pictures and len(cells) > 1:
        alt = "Cost, and collisions where there are obstacles, of each cell, with 95 % intervals"
        pictures += write_picture(folder, f"{study.stem}_cells", partial(cells_figure, cells), alt)

    shown = [cell for cell in cells if len(cell.good_paths)][:MOST_PATH_PANELS]
    titles = [title for cell, title in zip(cells, cell_titles(cells), strict=True) if cell in shown]
    caption = "Paths in the plane, a panel per cell"
    return pictures + write_path_panels(folder, f"{study.stem}_paths", shown, titles, caption)


def own_study_latex(study: OwnStudy) -> str:
    """Returns the cells as a LaTeX table: what differs, trials, cost, collisions, time."""
    cells = study.cells
    labels = differing_labels(cells)
    keys = [key for key in labels[0] if key != "controller"] if labels else []
    headings = ["Method", *(escaped(key.rpartition(".")[2]) for key in keys)]
    headings += ["Trials", "Cost", r"Collision (\%)", "Time (ms)"]
    rows = [
        _latex_row(cell, [cell_labels[key] for key in keys])
        for cell, cell_labels in zip(cells, labels, strict=True)
    ]
    caption = (
        rf"{escaped(study.title)}: cost as mean $\pm$ standard deviation, collision rate with "
        r"95\,\% Clopper--Pearson interval, median time of a control step. "
        f"{machine_sentence(cells)}".strip()
    )
    return render_latex(LatexTable(caption, f"tab:{study.stem}", headings, [rows]))


def differences_latex(study: OwnStudy, frame: pd.DataFrame) -> str:
    """Returns the differences to the baselines as a LaTeX table."""
    caption = f"{escaped(study.title)}: differences to a baseline on common random numbers; "
    caption += f"{escaped(multiplicity_text(frame))}."
    headings = [escaped(str(name)) for name in frame.columns]
    rows = [[escaped(text) for text in row] for row in frame.itertuples(index=False)]
    return render_latex(LatexTable(caption, f"tab:{study.stem}_differences", headings, [rows]))


def _latex_row(cell: CellResults, values: Sequence[str]) -> list[str]:
    """Returns the row of one cell, with the values of the keys that differ."""
    ours = summarise_trials(cell.rows, cell.seconds)
    return [
        escaped(cell.name),
        *("--" if value == "-" else escaped(value) for value in values),
        str(ours.good),
        "--" if math.isnan(ours.sd) else plus_minus(ours.cost.value, ours.sd),
        interval_text(ours.collided.times(100), 1).replace("-", "--"),
        latex_time(cell),
    ]
