"""The report's section on margins, from made-up results."""

import math

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from mppi_belief.report import figures
from mppi_belief.report.cell_results import CellResults
from mppi_belief.report.margin_planners import (
    DEVIATIONS,
    PLANNERS,
    THETA,
    WEIGHT,
    cells_by_planner,
    planner_of,
    setting_of,
    setting_text,
    swept_cells,
)
from mppi_belief.report.sections import study_sections
from mppi_belief.report.sections.margins import cheapest_safe_cell, range_sentences
from report_helpers import cell_of, failed_trial, results_of, trial_rows

LEVELS = {1.0: 0.15865525393145707, 2.0: 0.022750131948179195, 3.0: 0.0013498980316300933}


def margin_cell(
    path_cost: dict, hits: int, cost: float, method: str = "belief", w_obs: float = 300.0
) -> CellResults:
    """Returns 200 trials of a cell with these settings."""
    cell = cell_of(method, w_obs=w_obs)
    cell.config["controller"]["path_cost"] = path_cost
    rows = trial_rows(200, hits, cost=(cost, cost / 10), clearance=(cost / 100, 0.1))
    return results_of(cell, rows)


def by_points(
    theta: float, w_obs: float, spread: float, hits: int = 2, cost: float = 56.0
) -> CellResults:
    path_cost = {"theta": theta, "variance": "sigma_points", "sigma_point_spread": spread}
    return margin_cell(path_cost, hits, cost, w_obs=w_obs)


def exact(theta: float, w_obs: float, hits: int, cost: float) -> CellResults:
    return margin_cell({"theta": theta, "variance": "exact"}, hits, cost, w_obs=w_obs)


def chance(deviations: float, w_obs: float, hits: int, cost: float) -> CellResults:
    path_cost = {"level": LEVELS[deviations], "joint_steps": 1}
    return margin_cell(path_cost, hits, cost, "chance", w_obs)


def study() -> list[CellResults]:
    return [
        *(by_points(theta, 300, 4) for theta in (0.1, 1, 10)),
        *(by_points(1, w_obs, 4, hits=3) for w_obs in (10, 100)),
        by_points(1, 300, 2.25, hits=5, cost=52),
        by_points(1, 300, 9, hits=0, cost=58),
        *(exact(theta, 300, 1, 60 + theta) for theta in (0.1, 1, 10)),
        *(exact(1, w_obs, 40, 50) for w_obs in (10, 100)),
        *(chance(k, 300, 6 - 2 * round(k), 50 + k) for k in (1.0, 2.0, 3.0)),
        *(chance(2.0, w_obs, 2, 52) for w_obs in (10, 100)),
        results_of(cell_of("ce"), trial_rows(20)),
    ]


def test_planners_are_told_apart_by_how_they_take_the_variance():
    groups = cells_by_planner(study())
    assert [(planner, len(group)) for planner, group in groups.items()] == list(
        zip(PLANNERS, (7, 5, 5), strict=True)
    )
    assert planner_of(study()[-1]) == ""


def test_a_setting_is_swept_where_the_others_have_their_usual_values():
    points, moments, constraint = cells_by_planner(study()).values()
    assert [setting_of(cell, THETA) for cell in swept_cells(points, THETA)] == [0.1, 1, 10]
    assert [setting_of(cell, WEIGHT) for cell in swept_cells(points, WEIGHT)] == [10, 100, 300]
    assert [setting_of(cell, DEVIATIONS) for cell in swept_cells(points, DEVIATIONS)] == [1.5, 2, 3]
    assert [setting_of(cell, WEIGHT) for cell in swept_cells(moments, WEIGHT)] == [10, 100, 300]
    assert swept_cells(moments, DEVIATIONS) == []
    assert swept_cells(constraint, THETA) == []
    deviations = [setting_of(cell, DEVIATIONS) for cell in swept_cells(constraint, DEVIATIONS)]
    assert deviations == pytest.approx([1, 2, 3])


def test_a_joint_level_is_shared_among_the_steps():
    shared = margin_cell({"level": 30 * LEVELS[3.0], "joint_steps": 30}, 0, 50, "chance")
    assert setting_of(shared, DEVIATIONS) == pytest.approx(3)
    assert math.isnan(setting_of(shared, THETA)) or "theta" not in shared.config["controller"]
    assert setting_text(shared) == "w_obs 300, 3 sd"


def test_the_cheapest_cell_that_is_safe_enough_has_no_failed_trials():
    points = cells_by_planner(study())["sigma points"]
    cheapest = cheapest_safe_cell(points)
    assert cheapest is not None
    assert (setting_of(cheapest, DEVIATIONS), len(cheapest.good)) == (2, 200)
    failed = by_points(1, 300, 6.25, hits=0, cost=40)
    with_failure = results_of(failed.cell, [*trial_rows(200), failed_trial(200)])
    assert cheapest_safe_cell([with_failure]) is None
    assert cheapest_safe_cell([exact(1, 10, 40, 50)]) is None


def test_ranges_are_those_over_the_swept_setting():
    over_theta, over_weight = range_sentences(cells_by_planner(study()))
    assert over_theta.startswith(
        "Over theta from 0.1 to 10. sigma points: clearance 0.56 to 0.56 m"
    )
    assert "exact moments: clearance 0.60 to 0.70 m, collisions 0.5 to 0.5 %" in over_theta
    assert "chance" not in over_theta
    assert "exact moments: clearance 0.50 to 0.61 m, collisions 0.5 to 20.0 %" in over_weight
    assert "chance constraint: clearance 0.52 to 0.52 m, collisions 1.0 to 1.0 %" in over_weight


def test_the_section_compares_planners_at_equal_safety(tmp_path):
    (section,) = study_sections({"margins": study()}, tmp_path)
    assert section.title == "What the variance of the penalty amounts to"
    safest, every = (table.frame for table in section.tables)
    assert list(safest["planner"]) == list(PLANNERS)
    assert list(safest["setting"]) == [
        "theta 0.1, w_obs 300, 2 sd",
        "theta 0.1, w_obs 300",
        "w_obs 300, 2 sd",
    ]
    differences = [text.split()[0] for text in safest["above the chance constraint [95 %]"]]
    assert differences == ["4.00", "8.10", "-"]
    assert len(every) == 17
    assert list(every["deviations"][:1]) == ["2"]
    assert every["deviations"][7] == "-"
    assert every["sd"][0] == "5.60"
    assert {path.name for path in tmp_path.iterdir()} >= {"margins.png", "margins.csv"}


def test_the_figure_has_a_column_per_swept_setting():
    figure = figures.margins_figure(study())
    FigureCanvasAgg(figure).draw()
    panels = figure.axes
    assert len(panels) == 9
    assert [axes.get_xlabel() for axes in panels[-3:]] == [
        r"risk aversion $\theta$",
        r"obstacle weight $w_\mathrm{obs}$ (1/s)",
        r"standard deviations ($\sqrt{c}$ or $k$)",
    ]
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == list(PLANNERS)
    assert figures.margins_figure([results_of(cell_of("ce"), trial_rows(20))]) is None
