"""A study of any problem: its table, differences, pictures of the swept keys, LaTeX."""

import math

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from mppi_belief.report.cell_results import CellResults
from mppi_belief.report.figures.swept_keys import cells_figure, swept_figure, swept_numbers
from mppi_belief.report.sections.own_study import OwnStudy, own_study_section
from report_helpers import SCENE, cell_of, results_of, trial_rows

KEY = "system.current"


def swept_cells(*methods: str, clearance: float = 0.5) -> list[CellResults]:
    """Each method at three values of a key, without the paper's settings."""
    return [
        results_of(
            cell_of(method, **{KEY: value}),
            trial_rows(20, hits, (10.0 + value, 2.0), (clearance, 0.0)),
            departures=None,
        )
        for method in methods
        for hits, value in enumerate((0.1, 1.0, 4.0))
    ]


def with_path(cell: CellResults) -> CellResults:
    steps = [{"trial": 3, "step": k, "state": np.array([k, 1.0, 0, 0])} for k in range(3)]
    return cell._replace(paths=pd.DataFrame(steps), scene=SCENE)


def labels_of(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()] if figure.legends else []


def test_swept_numbers_are_the_keys_whose_values_are_numbers():
    assert swept_numbers(swept_cells("belief", "ce")) == [KEY]
    assert swept_numbers([]) == []
    seeds = [results_of(cell_of(seed=seed), trial_rows(3)) for seed in (0, 1)]
    assert swept_numbers(seeds) == []
    filters = [results_of(cell_of(filter=name), trial_rows(3)) for name in ("ekf", "ukf")]
    assert swept_numbers(filters) == []
    thetas = [
        results_of(cell_of(method, t), trial_rows(3))
        for method, t in (("belief", 0.0), ("belief", 1.0), ("ce", math.nan))
    ]
    assert swept_numbers(thetas) == ["theta"]


def test_a_line_joins_the_cells_that_differ_in_the_swept_key_alone():
    figure = swept_figure(swept_cells("belief", "ce"), KEY)
    costs, rates = figure.axes
    assert (costs.get_ylabel(), rates.get_ylabel()) == ("cost", "trials that collide (%)")
    assert rates.get_xlabel() == KEY
    assert rates.get_xscale() == "log"
    assert labels_of(figure) == ["MPPI-Belief", "CE-MPPI"]
    for bars in costs.containers:
        points = bars.lines[0].get_xydata()
        np.testing.assert_allclose(points, [[0.1, 10.1], [1.0, 11.0], [4.0, 14.0]])
    np.testing.assert_allclose(rates.containers[0].lines[0].get_ydata(), [0.0, 5.0, 10.0])


def test_without_obstacles_no_collisions_are_drawn():
    assert len(swept_figure(swept_cells("belief", clearance=math.inf), KEY).axes) == 1
    assert len(cells_figure(swept_cells("belief", clearance=math.inf)).axes) == 1


def test_nothing_is_drawn_of_no_trials():
    empty = [results_of(cell_of(**{KEY: value}), []) for value in (1, 2)]
    assert swept_figure(empty, KEY) is None
    assert cells_figure(empty) is None


def test_the_section_has_cells_differences_and_pictures_and_nothing_of_the_paper(tmp_path):
    cells = [with_path(cell) for cell in swept_cells("belief", "ce")]
    section = own_study_section(OwnStudy("mine", "Mine", cells), tmp_path, "Results")
    table, differences = section.tables
    assert table.caption.startswith("6 cells; intervals are at 95 %")
    assert differences.frame["Pairs"].tolist() == ["20"] * 5
    assert differences.frame["Difference"].tolist()[-1] == (
        "CE-MPPI (system.current 4) - MPPI-Belief (system.current 4)"
    )
    assert [picture.file for picture in section.pictures] == [
        "mine_by_current.png",
        "mine_paths.png",
    ]
    assert section.pictures[1].alt.endswith("1 of 20 trials of each panel is drawn")
    names = {path.name for path in tmp_path.iterdir()}
    for stem in ("mine", "mine_differences"):
        assert {f"{stem}.csv", f"{stem}.md", f"{stem}.tex"} <= names
    assert not [name for name in names if name.startswith(("table_1", "figure_1"))]
    texts = [*section.text, table.caption, differences.caption]
    texts += [(tmp_path / "mine.tex").read_text(), table.frame.to_string()]
    assert not any("aper" in text or "Table I" in text for text in texts)


def test_cells_are_drawn_row_by_row_where_no_number_is_swept(tmp_path):
    cells = [results_of(cell_of(method), trial_rows(20, 2)) for method in ("belief", "ce")]
    section = own_study_section(OwnStudy("mine", "Mine", cells), tmp_path, "Results")
    assert [picture.file for picture in section.pictures] == ["mine_cells.png"]
    names = [text.get_text() for text in cells_figure(cells).axes[0].get_yticklabels()]
    assert names == ["MPPI-Belief", "CE-MPPI"]


def test_a_single_cell_is_one_line_without_differences(tmp_path):
    cell = results_of(cell_of(), trial_rows(1, 1))
    section = own_study_section(OwnStudy("mine", "Mine", [cell]), tmp_path, "Results")
    assert len(section.tables) == 1
    assert section.tables[0].caption.startswith("1 cell;")
    assert section.text == []
    assert list(section.pictures) == []


def test_cells_without_the_key_are_counted_in_the_caption(tmp_path):
    thetas = [results_of(cell_of("belief", theta), trial_rows(5)) for theta in (0.0, 1.0)]
    cells = [*thetas, results_of(cell_of("ce", math.nan), trial_rows(5))]
    section = own_study_section(OwnStudy("mine", "Mine", cells), tmp_path, "Results")
    (picture,) = section.pictures
    assert picture.alt.endswith("over `theta`, with 95 % intervals; 2 of 3 cells have this key")
