"""The report's section on the study of two lanes, from made-up results."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mppi_belief.report import figures
from mppi_belief.report.cell_results import CellResults
from mppi_belief.report.figures.trajectories import plane_panel
from mppi_belief.report.sections import study_sections
from mppi_belief.report.sections.two_lanes import arrival_rate, filter_cells
from mppi_belief.report.statistics import proportion_interval
from report_helpers import SCENE, cell_of, failed_trial, results_of, trial_rows

pytestmark = pytest.mark.long

STARTS = [[0.5, 1.6], [0.5, -1.6]]


def cell_with(method: str, hits: int, arrived: int, **swept) -> CellResults:
    """Twenty trials of a method, of which the last ones arrive, and one that went wrong."""
    theta = swept.pop("theta", float("nan"))
    rows = [
        cell_item | {"final_distance": 0.9 if cell_item["trial"] >= 20 - arrived else 1.1}
        for cell_item in trial_rows(20, hits)
    ]
    return results_of(cell_of(method, theta=theta, **swept), [*rows, failed_trial(20)])


def pictured(cell_item: CellResults) -> CellResults:
    steps = [{"trial": 3, "step": k, "state": np.array([k, 1.0, 0, 0])} for k in range(3)]
    return cell_item._replace(paths=pd.DataFrame(steps), scene=SCENE | {"starts": STARTS})


def study() -> list[CellResults]:
    return [
        cell_with("belief", 1, 18, theta=1.0, filter="mixture"),
        cell_with("belief", 4, 7, theta=1.0, filter="ekf"),
        cell_with("belief", 2, 9, theta=0.0, filter="ekf"),
        cell_with("belief", 0, 0, theta=1.0, filter="mixture", schedule="moments"),
        cell_with("ce", 8, 15, filter="ekf"),
        cell_with("pipf", 3, 12),
    ]


def test_arrivals_are_counted_among_the_trials_that_went_well():
    assert [arrival_rate(cell_item) for cell_item in study()] == [
        proportion_interval(k, 20) for k in (18, 7, 9, 0, 15, 12)
    ]


def test_the_section_says_who_collides_and_who_arrives(tmp_path):
    (section,) = study_sections({"two_lanes": study()}, tmp_path)
    assert section.title == "Beyond the paper: a belief with two modes"
    frame = section.tables[0].frame
    assert [text.split()[0] for text in frame["arrived % [95 %]"]] == [
        "90.0",
        "35.0",
        "45.0",
        "0.0",
        "75.0",
        "60.0",
    ]
    assert list(frame["planned from"]) == ["-", "-", "-", "moments", "-", "-"]
    assert "MPPI-Belief (theta 1, filter mixture), from moments, collides in 0.0" in section.text[1]
    assert "MPPI-Belief (theta 1, filter ekf" in section.text[1]
    assert (
        "PIPF collides in 15.0 [3.2, 37.9] % of the trials and arrives in 60.0 [36.1, 80.9] %."
        in section.text[1]
    )
    assert section.pictures == []  # there are no paths


def test_the_picture_has_both_filters_of_each_planner_and_every_start(tmp_path):
    shown = filter_cells([pictured(cell_item) for cell_item in study()])
    assert [(cell.name, cell.labels["filter"], cell.labels["theta"]) for cell in shown[:2]] == [
        ("MPPI-Belief", "mixture", 1.0),
        ("MPPI-Belief", "ekf", 1.0),
    ]
    assert [(cell.name, cell.labels["filter"]) for cell in shown[2:]] == [("CE-MPPI", "ekf")]
    runs = [plane_panel(cell, cell.name) for cell in shown]
    figure = figures.compare_paths(runs)
    assert isinstance(figure, Figure)
    FigureCanvasAgg(figure).draw()
    for axes in figure.axes[:3]:
        starts = [
            list(zip(*line.get_data(), strict=True))
            for line in axes.lines
            if line.get_marker() == "o"
        ]
        np.testing.assert_allclose(starts, [STARTS])
