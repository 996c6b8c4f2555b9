"""Table I and Fig. 1: the methods beside the paper's numbers, and trial by trial."""

import math
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from .. import published
from ..cell_results import CellResults, cell_titles
from ..comparison import method_differences, multiplicity_text
from ..drawing import drawn
from ..elements import (
    bold_lowest_rate,
    collision_text,
    cost_text,
    drawn_text,
    latex_time,
    machine_sentence,
    write_page_table,
    write_picture,
)
from ..figures.animation import write_animation
from ..figures.figure_1 import figure_1
from ..frame_files import write_text_file
from ..latex import LatexTable, escaped, plus_minus, render_latex
from ..page import Picture, Section
from ..summary import interval_text, summarise_trials, time_text
from ..wording import listed

ANIMATION_GIF = "animation.gif"
RATE_COLUMN = "Collision %"


def table_1_section(cells: list[CellResults], folder: Path) -> Section:
    """Builds the section: Table I as text and LaTeX, paired differences, Fig. 1, animation."""
    write_text_file(folder / "table_1.tex", table_1_latex(cells))
    caption = "Table I. Cost: mean ± standard deviation"
    table = write_page_table(folder, "table_1", caption, table_1_frame(cells), cells)
    tables = [bold_lowest_rate(table, cells, RATE_COLUMN)]

    # The differences between the methods.
    pairs = method_differences(cells)
    if len(pairs):
        caption = f"MPPI-Belief against each method; {multiplicity_text(pairs)}"
        tables.append(write_page_table(folder, "table_1_differences", caption, pairs))

    # The pictures.
    alt = f"Fig. 1: {drawn_text(cells)}; shading: the noise of the position sensor"
    pictures = write_picture(folder, "figure_1", lambda: figure_1(cells), alt)
    if drawn(ANIMATION_GIF, lambda: write_animation(cells, folder / ANIMATION_GIF)):
        alt = "The recorded trial: true path, belief ellipse, sampled paths"
        pictures.append(Picture(ANIMATION_GIF, alt))

    with_trials = [cell for cell in cells if len(cell.good)]
    results = [
        f"{cell.name} costs {cost_text(cell)} and collides in {collision_text(cell)} of its trials."
        for cell in with_trials
    ]
    units = (
        "The cost is that of the true state, without the obstacle penalty. Times are medians of "
        "single control steps on the machine named under Provenance."
    )
    names = listed(list(dict.fromkeys(cell.name for cell in cells)))
    shown = "the four methods" if {cell.method for cell in cells} == {*published.TABLE_1} else names
    title = f"Table I and Fig. 1: {shown}"
    return Section(title, [" ".join(results), units], tables, pictures)


def published_row(cell: CellResults) -> published.PublishedRow | None:
    """Returns the row of Table I that a cell repeats; None for other settings and methods."""
    return published.TABLE_1.get(cell.method) if cell.has_paper_settings() else None


def table_1_frame(cells: Sequence[CellResults]) -> pd.DataFrame:
    """Returns Table I as text: our numbers beside the paper's."""
    titles = cell_titles(cells)
    return pd.DataFrame(
        [_text_line(title, cell) for title, cell in zip(titles, cells, strict=True)]
    )


def _text_line(title: str, cell: CellResults) -> dict[str, str]:
    """Returns the line of one cell."""
    ours = summarise_trials(cell.rows, cell.seconds)
    paper = published_row(cell)
    return {
        "Method": title,
        "Trials": str(ours.good),
        "Cost": "-" if math.isnan(ours.sd) else f"{ours.cost.value:.1f} ± {ours.sd:.1f}",
        "Paper: cost": f"{paper.cost} ± {paper.spread}" if paper else "-",
        "Collision %": interval_text(ours.collided.times(100), 1),
        "Paper: collision %": f"{_published_rate(paper):.1f}" if paper else "-",
        "Time ms (p95)": "-" if math.isnan(ours.time) else time_text(ours, cell.busy),
        "Paper: ms": f"{paper.time:g}" if paper else "-",
    }


def _published_rate(paper: published.PublishedRow) -> float:
    """Returns the paper's collision rate in %."""
    return 100 * paper.collisions / published.PAPER_TRIALS


def table_1_latex(cells: Sequence[CellResults]) -> str:
    """Returns Table I for the paper's preamble: per method a row of ours and one of the paper's."""
    titles = cell_titles(cells)
    caption = (
        "Comparative performance on the gradient light-dark domain: cost as mean "
        r"$\pm$ standard deviation, collision rate with 95\,\% Clopper--Pearson interval, median "
        f"time of a control step. {machine_sentence(cells)}".strip()
    )
    groups = [_latex_rows(title, cell) for title, cell in zip(titles, cells, strict=True)]
    headings = ["Method", "", "Trials", "Cost", r"Collision (\%)", "Time (ms)"]
    return render_latex(LatexTable(caption, "tab:exp_baseline", headings, groups))


def _latex_rows(title: str, cell: CellResults) -> list[list[str]]:
    """Returns the row of one cell and, where there is one, that of the paper."""
    ours = summarise_trials(cell.rows, cell.seconds)
    paper = published_row(cell)
    rate = interval_text(ours.collided.times(100), 1)
    rows = [
        [
            escaped(title),
            "here" if paper else "",
            str(ours.good),
            "--" if math.isnan(ours.sd) else plus_minus(ours.cost.value, ours.sd),
            "--" if rate == "-" else rate,
            latex_time(cell),
        ]
    ]
    if paper:
        cost = plus_minus(paper.cost, paper.spread)
        trials = str(published.PAPER_TRIALS)
        rate = f"{_published_rate(paper):.1f}"
        rows.append(["", "paper", trials, cost, rate, f"{paper.time:g}"])
    return rows
