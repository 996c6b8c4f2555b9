"""Table I and Fig. 1: the four methods beside the paper's numbers, and trial by trial."""

import math
import re
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from .. import published
from ..cell_results import CellResults, cell_titles
from ..comparison import method_differences
from ..drawing import drawn
from ..elements import collision_text, cost_text, write_page_table, write_picture
from ..figures.animation import write_animation
from ..figures.figure_1 import figure_1
from ..frame_files import write_text_file
from ..page import Picture, Section
from ..summary import interval_text, summarise_trials, time_text

ANIMATION_GIF = "animation.gif"


def table_1_section(cells: list[CellResults], folder: Path) -> Section:
    """Builds the section: Table I as text and LaTeX, paired differences, Fig. 1, animation."""
    # Table I, with the lowest collision rate in bold.
    write_text_file(folder / "table_1.tex", table_1_latex(cells))
    caption = "Table I. Cost: mean ± standard deviation"
    table = write_page_table(folder, "table_1", caption, table_1_frame(cells), cells)
    rates = [float(cell.collided.mean()) if len(cell.good) else math.inf for cell in cells]
    best = (rates.index(min(rates)), list(table.frame.columns).index("Collision %"))
    tables = [table._replace(bold=[best])]

    # The differences between the methods.
    pairs = method_differences(cells)
    if len(pairs):
        caption = "MPPI-Belief against each method, trial by trial"
        tables.append(write_page_table(folder, "table_1_differences", caption, pairs))

    # The pictures.
    alt = "Fig. 1: 50 trials of each method in the plane; shading: the noise of the position sensor"
    pictures = write_picture(folder, "figure_1", lambda: figure_1(cells), alt)
    if drawn(ANIMATION_GIF, lambda: write_animation(cells, folder / ANIMATION_GIF)):
        alt = "One trial of MPPI-Belief next to CE-MPPI: true path, belief ellipse, sampled paths"
        pictures.append(Picture(ANIMATION_GIF, alt))

    results = [
        f"{cell.name} costs {cost_text(cell)} and collides in {collision_text(cell)} of its trials."
        for cell in cells
    ]
    units = (
        "The cost is that of the true state, without the obstacle penalty. Times are medians of "
        "single control steps on the machine named under Provenance."
    )
    title = "Table I and Fig. 1: the four methods"
    return Section(title, [" ".join(results), units], tables, pictures)


def table_1_frame(cells: Sequence[CellResults]) -> pd.DataFrame:
    """Returns Table I as text: our numbers beside the paper's."""
    titles = cell_titles(cells)
    return pd.DataFrame(
        [_text_line(title, cell) for title, cell in zip(titles, cells, strict=True)]
    )


def _text_line(title: str, cell: CellResults) -> dict[str, str]:
    """Returns the line of one cell."""
    ours = summarise_trials(cell.rows, cell.seconds)
    paper = published.TABLE_1.get(cell.method)
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
    """Returns Table I for the paper's preamble (booktabs): our numbers, then the paper's."""
    titles = cell_titles(cells)
    lines = [
        r"\begin{table}[b]",
        r"\centering",
        r"\small",
        r"\caption{Comparative performance on the gradient light-dark domain: mean $\pm$ standard "
        r"deviation,",
        r"collision rate with 95\,\% Clopper--Pearson interval, median time of a control step.}",
        r"\label{tab:exp_baseline}",
        r"\setlength{\tabcolsep}{3pt}",
        r"\begin{tabular}{lcccccc}",
        r"\toprule",
        r" & \multicolumn{3}{c}{Reproduction} & \multicolumn{3}{c}{Published} \\",
        r"\cmidrule(lr){2-4}\cmidrule(lr){5-7}",
        r"Method & Cost & Collision (\%) & ms & Cost & Coll. & ms \\",
        r"\midrule",
        *(_latex_line(title, cell) for title, cell in zip(titles, cells, strict=True)),
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def _latex_line(title: str, cell: CellResults) -> str:
    """Returns the LaTeX line of one cell."""
    ours = summarise_trials(cell.rows, cell.seconds)
    paper = published.TABLE_1.get(cell.method)
    rate = ours.collided.times(100)
    interval = rf"${rate.value:.1f}$ [{rate.low:.1f}, {rate.high:.1f}]"
    entries = [
        re.sub(r"([&%$#_{}])", r"\\\1", title),
        "--" if math.isnan(ours.sd) else rf"${ours.cost.value:.1f} \pm {ours.sd:.1f}$",
        "--" if math.isnan(rate.value) else interval,
        "--" if math.isnan(ours.time) else f"{ours.time:.1f}",
        rf"${paper.cost} \pm {paper.spread}$" if paper else "--",
        rf"{_published_rate(paper):.1f}\%" if paper else "--",
        f"{paper.time:g}" if paper else "--",
    ]
    return " & ".join(entries) + r" \\"
