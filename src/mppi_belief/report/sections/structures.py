"""Shows two structures beside each other: that of Table I here, that of the first calibration."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from .. import published
from ..cell_results import METHOD_NAMES, CellResults, Studies, by_method
from ..elements import write_page_table
from ..open_settings import setting_text, shown_key
from ..page import Section
from ..summary import TrialSummary, summarise_trials

STUDY = "table_1_bumps"
WEIGHTS = (100.0, 2500.0, 10000.0)  # of conf/experiment/table_1_bumps.weights.yaml


class Structure(NamedTuple):
    """Holds the cells of a structure by what they repeat."""

    name: str  # of the study of its Table I
    table_1: list[CellResults]
    theta: list[CellResults]  # MPPI-Belief over theta
    weights: list[CellResults]  # every method over the obstacle weight


def structures_section(studies: Studies, folder: Path) -> Section:
    """Builds the section: the published numbers and the settings of both structures."""
    structures = [_first_calibration(studies[STUDY])]
    if "table_1" in studies:
        sweeps = [studies.get(name, []) for name in ("theta_sweep", "w_obs_sweep")]
        structures.insert(0, Structure("table_1", studies["table_1"], *sweeps))
    tables = [
        write_page_table(
            folder, "structures", "Published numbers by structure", numbers_frame(structures)
        ),
        write_page_table(
            folder, "structure_settings", "Settings by structure", settings_frame(structures)
        ),
    ]
    text = (
        f"`{STUDY}` has the structure of the first calibration, Gaussian bumps and the exact "
        "moments of their penalty, with numbers of its own that were fitted to Table I in the same "
        "way. All columns are of trials that met the same noise."
    )
    return Section("What the structure changes", [text], tables)


def _first_calibration(cells: Sequence[CellResults]) -> Structure:
    """Sorts the cells of the study by what they repeat."""
    weight = cells[0].labels["w_obs"]
    at_weight = [cell for cell in cells if cell.labels["w_obs"] == weight]
    table_1 = [cell for cell in at_weight if _has_theta_of_table_1(cell)]
    theta = by_method(at_weight).get("belief", [])
    return Structure(STUDY, table_1, theta, [cell for cell in cells if _has_theta_of_table_1(cell)])


def _has_theta_of_table_1(cell: CellResults) -> bool:
    """Returns whether a cell has the theta of Table I, or a method without one."""
    return cell.method != "belief" or cell.labels["theta"] == published.TABLE_1_THETA


def numbers_frame(structures: Sequence[Structure]) -> pd.DataFrame:
    """Returns the published numbers as text: a line per number, a column per structure."""
    lines = [*_table_1_lines(structures), *_theta_lines(structures), *_weight_lines(structures)]
    columns = ["Number", "Paper", *(structure.name for structure in structures)]
    return pd.DataFrame(lines, columns=columns)


def _table_1_lines(structures: Sequence[Structure]) -> Iterator[list[str]]:
    """Yields costs and collision rates of Table I."""
    for method, row in published.TABLE_1.items():
        cells = [_only(structure.table_1, method) for structure in structures]
        rate = 100 * row.collisions / published.PAPER_TRIALS
        name = METHOD_NAMES[method]
        yield [f"{name}, cost", f"{row.cost} ± {row.spread}", *(_texts(cells, _cost_and_spread))]
        yield [f"{name}, collisions %", f"{rate:.1f}", *_texts(cells, _rate)]


def _theta_lines(structures: Sequence[Structure]) -> Iterator[list[str]]:
    """Yields the row theta = 0, and the clearance over the other theta."""
    paper = published.PAPER_THETA[0.0]
    cells = [_only(structure.theta, "belief", theta=0.0) for structure in structures]
    rate = f"{100 * paper.collision_rate[0]:.1f}"
    yield ["theta 0, collisions %", rate, *_texts(cells, _rate)]
    yield ["theta 0, clearance m", f"{paper.clearance:.2f}", *_texts(cells, _clearance)]
    yield ["theta 0, cost", f"{paper.cost}", *_texts(cells, _cost)]
    for theta in (0.5, 1.0, 5.0):
        clearance = published.PAPER_THETA[theta].clearance
        cells = [_only(structure.theta, "belief", theta=theta) for structure in structures]
        text = "-" if clearance is None else f"{clearance:.2f}"
        yield [f"theta {theta:g}, clearance m", text, *_texts(cells, _clearance)]


def _weight_lines(structures: Sequence[Structure]) -> Iterator[list[str]]:
    """Yields the collision rates at the weights that the first calibration has."""
    low, high = (100 * rate for rate in published.BASELINE_RANGE)
    for method in published.TABLE_1:
        for weight in WEIGHTS:
            cells = [_only(structure.weights, method, w_obs=weight) for structure in structures]
            if not any(cells):
                continue
            paper = f"{low:g} to {high:g}"
            if method == "belief":
                bound = published.belief_rate_bound(weight)
                paper = "-" if bound is None else f"{100 * bound:.1f}"
            label = f"w_obs {weight:g}, {METHOD_NAMES[method]}, collisions %"
            yield [label, paper, *_texts(cells, _rate)]


def settings_frame(structures: Sequence[Structure]) -> pd.DataFrame:
    """Returns the settings that the paper leaves open: a line per key, a column per structure."""
    meanings = {key: choice.meaning for key, choice in published.STRUCTURE.items()}
    lines = []
    for key, meaning in (meanings | published.FITTED_SETTINGS).items():
        values = [setting_text(structure.table_1, key) or "-" for structure in structures]
        if set(values) != {"-"}:
            lines.append([shown_key(key), meaning, *values])
    columns = ["Key", "Meaning", *(structure.name for structure in structures)]
    return pd.DataFrame(lines, columns=columns)


def _only(cells: Sequence[CellResults], method: str, **labels: float) -> CellResults | None:
    """Returns the first cell of a method with these labels and at least one good trial."""
    for cell in by_method(cells).get(method, []):
        if len(cell.good) and all(cell.labels[name] == value for name, value in labels.items()):
            return cell
    return None


def _texts(
    cells: Sequence[CellResults | None], text_of: Callable[[TrialSummary], str]
) -> list[str]:
    """Returns a text per cell, "-" where there is none."""
    return ["-" if cell is None else text_of(summarise_trials(cell.rows, None)) for cell in cells]


def _cost_and_spread(summary: TrialSummary) -> str:
    return f"{summary.cost.value:.1f} ± {summary.sd:.1f}"


def _cost(summary: TrialSummary) -> str:
    return f"{summary.cost.value:.1f}"


def _rate(summary: TrialSummary) -> str:
    return f"{100 * summary.collided.value:.1f}"


def _clearance(summary: TrialSummary) -> str:
    return f"{summary.clearance.value:.2f}"
