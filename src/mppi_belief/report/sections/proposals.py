"""Beyond the paper: how many sampled paths a step needs, by the policy that samples them."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from ..cell_results import CellResults
from ..comparison import cost_difference
from ..elements import cell_lines, write_page_table, write_picture
from ..figures.sampling_efficiency import PROPOSAL_KEY, proposals_figure
from ..page import Section
from ..statistics import Estimate
from ..summary import interval_text, label_text, summarise_trials


class Saving(NamedTuple):
    """Holds how few samples from the Laplace proposal do better than many about the nominal."""

    nominal: CellResults  # the cell with most samples about the nominal
    laplace: CellResults  # the cell with fewest samples that costs less with certainty
    less: Estimate  # cost of the first minus that of the second


def proposals_section(cells: list[CellResults], folder: Path) -> Section:
    """Builds the section: all cells with effective samples per ms, and cost against time."""
    frame = cell_lines(cells)
    frame.insert(1, "system", [cell.system for cell in cells])
    frame.insert(
        list(frame.columns).index("ESS") + 1, "ESS/ms", [_ess_per_ms(cell) for cell in cells]
    )
    main_cells = [cell for cell in cells if _scenario(cell) == _scenario(cells[0])]
    caption = "Every planner, proposal and number of samples"
    alt = (
        "Cost and effective sample size against milliseconds per step; one line per planner and "
        "proposal"
    )
    return Section(
        "Beyond the paper: where paths are sampled",
        [
            "The paper samples controls about a nominal that is the same for all paths. The "
            "Laplace proposal samples them from the optimal feedback policy of the problem "
            "expanded about that nominal, and corrects the weights accordingly; one path in five "
            "still comes from the nominal. For many samples both give the same control.",
            " ".join([*_ess_gain(cells), *_savings(main_cells)]),
        ],
        [write_page_table(folder, "proposals", caption, frame, cells)],
        write_picture(folder, "proposals", lambda: proposals_figure(main_cells), alt),
    )


def proposal_pairs(cells: Sequence[CellResults]) -> Iterator[tuple[CellResults, CellResults]]:
    """Yields the pairs of cells that differ in nothing but the proposal: nominal, Laplace."""
    nominal_cells = [cell for cell in cells if cell.labels.get(PROPOSAL_KEY) == "nominal"]
    laplace_cells = [cell for cell in cells if cell.labels.get(PROPOSAL_KEY) == "laplace"]
    for nominal in nominal_cells:
        for laplace in laplace_cells:
            if _labels_without_proposal(nominal) == _labels_without_proposal(laplace):
                yield nominal, laplace


def _labels_without_proposal(cell: CellResults) -> dict[str, str]:
    return {name: label_text(value) for name, value in cell.labels.items() if name != PROPOSAL_KEY}


def sample_saving(cells: Sequence[CellResults], method: str) -> Saving | None:
    """Finds the fewest samples from the Laplace proposal that cost less, with 95 % confidence.

    They are compared with most samples about the nominal. Returns None where there are none.
    """
    cells = [cell for cell in cells if cell.method == method and len(cell.good) > 1]
    nominal_cells = [cell for cell in cells if cell.labels.get(PROPOSAL_KEY) == "nominal"]
    if not nominal_cells:
        return None
    most = max(nominal_cells, key=lambda cell: cell.samples or 0)
    for cell in sorted(cells, key=lambda cell: cell.samples or 0):
        if cell.labels.get(PROPOSAL_KEY) == "laplace":
            less = cost_difference(most, cell)
            if less.low >= 0:
                return Saving(most, cell, less)
    return None


def _scenario(cell: CellResults) -> tuple[str, str]:
    return cell.system, label_text(cell.labels["w_obs"])


def _ess_gain(cells: Sequence[CellResults]) -> list[str]:
    """Says what the proposal does to the effective sample size, over all pairs of cells."""
    ratios = []
    for nominal, laplace in proposal_pairs(cells):
        nominal_ess = summarise_trials(nominal.rows, None).ess
        laplace_ess = summarise_trials(laplace.rows, None).ess
        if nominal_ess > 0 and math.isfinite(laplace_ess):
            ratios.append(laplace_ess / nominal_ess)
    if not ratios:
        return []
    return [
        f"With it the effective sample size is {min(ratios):.2g} to {max(ratios):.2g} times that "
        "about the nominal."
    ]


def _savings(cells: Sequence[CellResults]) -> list[str]:
    """Says for each method how few samples do what the nominal does with most."""
    sentences = []
    for method in dict.fromkeys(cell.method for cell in cells):
        saving = sample_saving(cells, method)
        if saving is not None:
            sentences.append(
                f"{saving.laplace.name} with {saving.laplace.samples} samples from it costs "
                f"{interval_text(saving.less, 2)} less than with {saving.nominal.samples} samples "
                f"about the nominal{_times(saving)}."
            )
    return sentences


def _times(saving: Saving) -> str:
    """Compares the times of a step, if both cells were timed."""
    laplace = summarise_trials(saving.laplace.rows, saving.laplace.seconds).time
    nominal = summarise_trials(saving.nominal.rows, saving.nominal.seconds).time
    if not (math.isfinite(laplace) and math.isfinite(nominal)):
        return ""
    return f", in {laplace:.2f} ms per step instead of {nominal:.2f}"


def _ess_per_ms(cell: CellResults) -> str:
    summary = summarise_trials(cell.rows, cell.seconds)
    rate = summary.ess / summary.time
    return f"{rate:.0f}" if math.isfinite(rate) else "-"
