"""Table I's four methods side by side: with the paper, and with each other trial by trial."""

import math
import re
from collections.abc import Sequence

import pandas as pd

from . import published
from .cell_results import CellResults, cell_titles, paired_rows
from .statistics import Estimate, paired_mean_difference, paired_rate_difference
from .summary import TrialSummary, interval_text, summarise_trials


def table_1(founds: Sequence[CellResults]) -> pd.DataFrame:
    """Table I as text: ours, the paper's numbers beside them."""
    named = zip(cell_titles(founds), founds, strict=True)
    return pd.DataFrame(
        [_line(name, found, summarise_trials(found.rows, found.seconds)) for name, found in named]
    )


def _line(name: str, found: CellResults, ours: TrialSummary) -> dict[str, str]:
    paper = published.TABLE_1.get(found.method)
    return {
        "Method": name,
        "Trials": str(ours.good),
        "Cost": "-" if math.isnan(ours.sd) else f"{ours.cost.value:.1f} ± {ours.sd:.1f}",
        "Paper: cost": f"{paper.cost} ± {paper.spread}" if paper else "-",
        "Collision %": interval_text(ours.collided.times(100), 1),
        "Paper: collision %": f"{100 * paper.collisions / published.TRIALS:.1f}" if paper else "-",
        "Time ms (p95)": "-" if math.isnan(ours.time) else f"{ours.time:.2f} ({ours.time_p95:.2f})",
        "Paper: ms": f"{paper.time:g}" if paper else "-",
    }


def method_differences(founds: Sequence[CellResults], reference: str = "belief") -> pd.DataFrame:
    """Each method against the reference over the trials both have, which met the same noise: difference
    reference - method of cost (BCa bootstrap) and collision rate (exact, McNemar), in text."""
    names = cell_titles(founds)
    at = next((index for index, found in enumerate(founds) if found.method == reference), None)
    lines = []
    for index, found in enumerate(founds):
        if at is None or index == at:
            continue
        one, other = paired_rows(founds[at], found)
        cost = paired_mean_difference(one["cost"].to_numpy(), other["cost"].to_numpy())
        rate, p = paired_rate_difference(
            one["collided"].to_numpy(bool), other["collided"].to_numpy(bool)
        )
        lines.append(_difference(names[at], names[index], len(one), cost, rate, p))
    return pd.DataFrame(lines)


def _difference(
    reference: str, name: str, n: int, cost: Estimate, rate: Estimate, p: float
) -> dict[str, str]:
    return {
        "Difference": f"{reference} - {name}",
        "Pairs": str(n),
        "Cost [95 %]": interval_text(cost, 2),
        "Collisions, points [95 %]": interval_text(rate.times(100), 1),
        "McNemar p": "-" if math.isnan(p) else f"{p:.2g}",
    }


def as_latex(founds: Sequence[CellResults]) -> str:
    """Table I for the paper's preamble (booktabs): ours where the paper has its own, and the paper's."""
    lines = [
        r"\begin{table}[b]",
        r"\centering",
        r"\small",
        r"\caption{Comparative performance on the gradient light-dark domain: mean $\pm$ standard deviation,",
        r"collision rate with 95\,\% Clopper--Pearson interval, median time of a control step.}",
        r"\label{tab:exp_baseline}",
        r"\setlength{\tabcolsep}{3pt}",
        r"\begin{tabular}{lcccccc}",
        r"\toprule",
        r" & \multicolumn{3}{c}{Reproduction} & \multicolumn{3}{c}{Published} \\",
        r"\cmidrule(lr){2-4}\cmidrule(lr){5-7}",
        r"Method & Cost & Collision (\%) & ms & Cost & Coll. & ms \\",
        r"\midrule",
        *(
            _latex_line(name, found)
            for name, found in zip(cell_titles(founds), founds, strict=True)
        ),
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def _latex_line(name: str, found: CellResults) -> str:
    ours, paper = summarise_trials(found.rows, found.seconds), published.TABLE_1.get(found.method)
    rate = ours.collided.times(100)
    cells = [
        re.sub(r"([&%$#_{}])", r"\\\1", name),
        "--" if math.isnan(ours.sd) else rf"${ours.cost.value:.1f} \pm {ours.sd:.1f}$",
        "--"
        if math.isnan(rate.value)
        else rf"${rate.value:.1f}$ [{rate.low:.1f}, {rate.high:.1f}]",
        "--" if math.isnan(ours.time) else f"{ours.time:.1f}",
        rf"${paper.cost} \pm {paper.spread}$" if paper else "--",
        rf"{100 * paper.collisions / published.TRIALS:.1f}\%" if paper else "--",
        f"{paper.time:g}" if paper else "--",
    ]
    return " & ".join(cells) + r" \\"
