"""Reports what the variance of a compact penalty amounts to: sigma points, exact moments, a chance
constraint, over four decades of theta and w_obs and at equal collision rate."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from ..cell_results import CellResults
from ..comparison import cost_difference
from ..elements import collision_text, cost_text, write_page_table, write_picture
from ..figures.margins import margins_figure
from ..margin_planners import (
    CHANCE,
    DEVIATIONS,
    SETTINGS,
    THETA,
    WEIGHT,
    cells_by_planner,
    planner_of,
    setting_of,
    setting_text,
    swept_cells,
)
from ..page import PageTable, Section
from ..summary import interval_text, summarise_trials, summary_text

ACCEPTED_RATE = 0.01  # of trials that collide, for the comparison at equal safety; a choice
ABOVE_CHANCE = "above the chance constraint [95 %]"
SETTING_COLUMNS = {
    THETA: THETA,
    WEIGHT: WEIGHT,
    DEVIATIONS: "deviations",
}  # "sd" is that of the cost


def margins_section(cells: list[CellResults], folder: Path) -> Section:
    """Builds the section: ranges over each setting, planners at equal safety, all cells."""
    groups = cells_by_planner(cells)
    shown = [cell for group in groups.values() for cell in group]
    safest = {planner: cheapest_safe_cell(group) for planner, group in groups.items()}
    return Section(
        "What the variance of the penalty amounts to",
        [
            "Sigma points at sqrt(c) standard deviations see a penalty of compact support only "
            "where one of them is inside. Once that costs more than a detour, neither theta nor "
            "w_obs matters: they keep a margin of sqrt(c) standard deviations, as a chance "
            "constraint does that enlarges obstacles by k standard deviations. Exact moments see "
            "the penalty at any distance, and keep a margin that grows with theta and w_obs. A "
            "penalty on the distance to discs has no moments in closed form: there `exact` is a "
            "rule of 37 points, of which the farthest is 3 standard deviations away, and so again "
            "a margin.",
            *range_sentences(groups),
            *safety_sentences(safest),
        ],
        [
            safety_table(safest, folder),
            write_page_table(
                folder, "margins", "Every planner and setting", margins_frame(shown), shown
            ),
        ],
        write_picture(
            folder,
            "margins",
            lambda: margins_figure(cells),
            "Collision rate, clearance and cost of the three planners over theta, the obstacle "
            "weight and the number of standard deviations, with 95 % intervals",
        ),
    )


def margins_frame(cells: Sequence[CellResults]) -> pd.DataFrame:
    """Returns a line of text per cell, with its planner and settings."""
    lines = []
    for cell in cells:
        labels = {"planner": planner_of(cell)}
        labels |= {
            SETTING_COLUMNS[name]: f"{round(setting_of(cell, name), 2) + 0.0:g}".replace("nan", "-")
            for name in SETTINGS
        }
        lines.append(summary_text(cell.rows, labels, cell.seconds, cell.busy))
    return pd.DataFrame(lines).fillna("-")


def range_sentences(groups: dict[str, list[CellResults]]) -> list[str]:
    """Says for theta and w_obs how far clearance, collisions and cost of each planner change."""
    sentences = []
    for name in (THETA, WEIGHT):
        parts = []
        ends: list[float] = []
        for planner, group in groups.items():
            curve = swept_cells(group, name)
            if curve:
                ends += [setting_of(curve[0], name), setting_of(curve[-1], name)]
                parts.append(f"{planner}: {_range_text(curve)}")
        if parts:
            sentences.append(
                f"Over {name} from {min(ends):g} to {max(ends):g}. {'; '.join(parts)}."
            )
    return sentences


def _range_text(cells: Sequence[CellResults]) -> str:
    summaries = [summarise_trials(cell.rows, None) for cell in cells]
    clearances = [summary.clearance.value for summary in summaries]
    rates = [100 * summary.collided.value for summary in summaries]
    costs = [summary.cost.value for summary in summaries]
    return (
        f"clearance {min(clearances):.2f} to {max(clearances):.2f} m, collisions "
        f"{min(rates):.1f} to {max(rates):.1f} %, cost {min(costs):.1f} to {max(costs):.1f}"
    )


def cheapest_safe_cell(group: Sequence[CellResults]) -> CellResults | None:
    """Returns the cell of one planner with the lowest cost of those that collide seldom enough.

    None where no setting keeps to `ACCEPTED_RATE`. Trials that failed rule a cell out.
    """
    safe = [
        cell
        for cell in group
        if len(cell.good) == len(cell.rows)
        and summarise_trials(cell.rows, None).collided.value <= ACCEPTED_RATE
    ]
    return min(safe, key=lambda cell: summarise_trials(cell.rows, None).cost.value, default=None)


def safety_sentences(safest: dict[str, CellResults | None]) -> list[str]:
    """Says which setting of each planner is the cheapest that collides seldom enough."""
    parts = []
    for planner, cell in safest.items():
        if cell is None:
            parts.append(f"{planner}: no setting")
        else:
            parts.append(
                f"{planner} with {setting_text(cell)}: cost {cost_text(cell)}, collisions "
                f"{collision_text(cell)}"
            )
    if not parts:
        return []
    return [
        f"The cheapest setting with at most {100 * ACCEPTED_RATE:g} % of collisions. "
        f"{'; '.join(parts)}. Settings were chosen by these same trials."
    ]


def safety_table(safest: dict[str, CellResults | None], folder: Path) -> PageTable:
    """Writes the table of the cheapest settings that collide seldom enough.

    Costs are compared with the chance constraint's trial by trial.
    """
    cells = [cell for cell in safest.values() if cell is not None]
    reference = safest.get(CHANCE)
    lines = []
    for cell in cells:
        labels = {"planner": planner_of(cell), "setting": setting_text(cell)}
        line = summary_text(cell.rows, labels, cell.seconds, cell.busy)
        if reference is not None and cell is not reference:
            line[ABOVE_CHANCE] = interval_text(cost_difference(cell, reference), 2)
        lines.append(line)
    caption = f"The cheapest setting of each planner with at most {100 * ACCEPTED_RATE:g} % of "
    caption += "collisions"
    frame = pd.DataFrame(lines).fillna("-")
    return write_page_table(folder, "margins_equal_safety", caption, frame, cells)
