"""The section on consistency: which cells it calls consistent, its bands, its figure."""

import math

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from scipy.stats import chi2

from mppi_belief.config.cell import Cell
from mppi_belief.report import figures
from mppi_belief.report.cell_results import CellResults
from mppi_belief.report.sections import nonlinearity, study_sections
from mppi_belief.report.statistics import chi_square_band
from report_helpers import cell_of, results_of, spread_values
from study_helpers import row

pytestmark = pytest.mark.long

N = 40
STEPS = 60
NX = 4
NY = 2


def cell(
    filter: str, curvature: float, nees: float, nis: float, loss: float = 1.5, recorded: bool = True
) -> CellResults:
    """Returns a cell of `system=bent` with these means; the oracle costs `loss` less per trial."""
    base = cell_of(**{"filter": filter, "system.curvature": curvature}).config
    config = base | {
        "names": base["names"] | {"filter": filter, "system": "bent"},
        "system": {"curvature": curvature},
    }
    columns = zip(spread_values(N, NX * nees, 0.4), spread_values(N, NY * nis, 0.05), strict=True)
    rows = [
        row(i, cost=40 + i + loss, nees=e, nis=d, steps=STEPS) for i, (e, d) in enumerate(columns)
    ]
    notes = {
        "tangent": {
            "part": [0.1 * curvature, None, 0.3 * curvature],
            "states": NX,
            "measurements": NY,
        }
    }
    return results_of(Cell(config), rows)._replace(recording=notes if recorded else None)


def oracle() -> CellResults:
    base = cell_of("oracle").config
    config = base | {
        "names": base["names"] | {"filter": "ekf", "system": "bent"},
        "system": {"curvature": 1.0},
    }
    return results_of(Cell(config), [row(i, cost=40.0 + i) for i in range(N)])


@pytest.fixture
def cells() -> list[CellResults]:
    return [
        oracle(),
        cell("ukf", 1.0, 1.0, 1.0),
        cell("ekf", 1.0, 1.6, 1.0, loss=2.5),
        cell("ekf", 0.0, 1.0, 1.0),
        cell("ekf", 2.0, 1.0, 0.9),
    ]


def test_bands_are_those_of_chi_square():
    for freedom in (1, 80, 4800):
        expected = [1.0, *chi2.ppf([0.025, 0.975], freedom) / freedom]
        np.testing.assert_allclose(chi_square_band(freedom), expected, rtol=1e-9)
    nees, nis = nonlinearity.consistency_bands(NX, NY, N, STEPS)
    assert (nees, nis) == (chi_square_band(NX * N), chi_square_band(NY * N * STEPS))


def test_every_cell_is_a_point_with_its_residual_and_its_loss(cells):
    points = nonlinearity.consistency_points(cells)
    assert [(point.filter, point.curvature) for point in points] == [
        ("ekf", 0),
        ("ekf", 1),
        ("ekf", 2),
        ("ukf", 1),
    ]
    assert [point.residual for point in points] == pytest.approx([0, 0.2, 0.4, 0.2])
    assert [point.nees.value for point in points] == pytest.approx([1, 1.6, 1, 1])
    assert [point.nis.value for point in points] == pytest.approx([1, 1, 0.9, 1])
    assert [point.loss.value for point in points] == pytest.approx([1.5, 2.5, 1.5, 1.5])


def test_either_statistic_off_its_band_is_inconsistent(cells):
    assert [point.consistent for point in nonlinearity.consistency_points(cells)] == [
        True,
        False,
        False,
        True,
    ]
    ekf, ukf = nonlinearity.verdicts(nonlinearity.consistency_points(cells))
    assert "not consistent at curvature 1 (NEES 1.60 [1.57, 1.63]), 2 (" in ekf
    assert "2.50 [2.50, 2.50] at 1" in ekf
    assert "UKF on bent: consistent at every curvature" in ukf


def test_a_mean_that_a_few_lost_trials_make_is_not_consistent_however_wide_its_interval():
    """NEES of 2 trials out of 40 a thousand times what it should be."""
    spoiled = cell("ekf", 1.0, 1.0, 1.0)
    spoiled.rows.loc[:1, "nees"] = 4000.0
    (point,) = nonlinearity.consistency_points([oracle(), spoiled])
    assert point.nees.low < 1
    assert not point.consistent
    assert (point.lost.value, point.lost.high) == pytest.approx((0.05, 0.16920), abs=1e-4)


def test_without_an_oracle_or_a_recording_there_is_less_to_say():
    (point,) = nonlinearity.consistency_points([cell("ekf", 1.0, 1.0, 1.0, recorded=False)])
    assert math.isnan(point.loss.value)
    assert math.isnan(point.residual)
    assert math.isnan(point.nees.value)
    assert not point.consistent
    (line,) = nonlinearity.consistency_frame([point]).to_dict("records")
    assert [
        line[name]
        for name in ("Residual", "NEES/nx [95 %]", "NEES band", "Lost % [95 %]", "Loss [95 %]")
    ] == ["-"] * 5


def test_the_section_has_a_table_for_people_and_one_for_machines(cells, tmp_path):
    (base,) = study_sections({"nonlinearity": cells}, tmp_path)
    assert base.title.startswith("Consistency")
    assert list(base.tables[0].frame["Filter"]) == ["EKF", "EKF", "EKF", "UKF"]
    numbers = pd.read_csv(tmp_path / "consistency.csv")
    np.testing.assert_allclose(numbers["loss"], [1.5, 2.5, 1.5, 1.5])
    np.testing.assert_allclose(numbers["nees_band_high"], chi2.ppf(0.975, NX * N) / (NX * N))
    assert (tmp_path / "consistency.png").stat().st_size > 10_000


def test_the_figure_shows_the_points(cells):
    points = nonlinearity.consistency_points(cells)
    figure = figures.consistency_figure(points)
    assert isinstance(figure, Figure)
    residual, middle, loss = figure.axes
    np.testing.assert_allclose(residual.lines[0].get_ydata(), [0, 0.2, 0.4], atol=1e-12)
    labels = middle.get_legend_handles_labels()[1]
    assert {
        "NEES, EKF",
        "NIS, EKF",
        "NEES, UKF",
        "NIS, UKF",
        "95 % band of NEES",
        "95 % band of NIS",
    } == set(labels)
    heights = [container.lines[0].get_ydata() for container in loss.containers]
    np.testing.assert_allclose(np.concatenate(heights), [1.5, 2.5, 1.5, 1.5])
    assert figures.consistency_figure([]) is None
