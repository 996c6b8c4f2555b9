"""Targets of a structure: met, not met or not tested, each with the number behind the verdict."""

import math

import numpy as np
import pytest
from scipy import stats

from mppi_belief.report import published, targets
from mppi_belief.report.cell_results import CellResults, Studies
from mppi_belief.report.targets import MET, NOT_MET, NOT_TESTED, Target, evaluate_targets, paired_z
from report_helpers import cell_of, results_of, trial_rows

CLEARANCE = {0.0: 0.11, 0.5: 0.80, 1.0: 0.82, 2.0: 0.81, 5.0: 0.83}  # m, by theta
HITS = {0.0: 46, 0.5: 5, 1.0: 0, 2.0: 2, 5.0: 2}  # of 200, by theta


def table_1(n: int = 200, hits: int = 0) -> list[CellResults]:
    """The paper's own Table I, but for the collisions of MPPI-Belief."""
    cells = []
    for method, row in published.TABLE_1.items():
        collisions = hits if method == "belief" else round(row.collisions * n / 200)
        spread = (0.11, 0.3) if method == "ce" else (0.8, 0.3)
        rows = trial_rows(n, collisions, (row.cost, row.spread), spread)
        cells.append(results_of(cell_of(method), rows))
    return cells


def theta_sweep(n: int = 200, **clearance: float) -> list[CellResults]:
    """The paper's theta sweep; theta0=0.3 changes the clearance at theta = 0."""
    cells = []
    for theta, far in CLEARANCE.items():
        far = clearance.get(f"theta{theta:g}".replace(".", "_"), far)
        cost = (50.5, 6.2) if theta == 0 else (56.5, 5.2)
        rows = trial_rows(n, round(HITS[theta] * n / 200), cost, (far, 0.3))
        cells.append(results_of(cell_of(theta=theta), rows))
    return cells


def w_obs_sweep(baselines: float = 20.0, n: int = 200, **belief: float) -> list[CellResults]:
    """The paper's sweep, the baselines at one rate in %; w2500=0.5 changes MPPI-Belief's."""
    cells = []
    for w_obs in published.FIG_2_WEIGHTS:
        for method in published.BASELINES:
            rows = trial_rows(n, round(n * baselines / 100))
            cells.append(results_of(cell_of(method, w_obs=w_obs), rows))
        rate = belief.get(f"w{w_obs:g}", 0.0)
        rows = trial_rows(n, round(n * rate / 100))
        cells.append(results_of(cell_of(w_obs=w_obs), rows))
    return cells


def papers() -> Studies:
    """All studies with the paper's own numbers."""
    return {
        "table_1": table_1(),
        "table_1_long": table_1(2000, hits=10),
        "theta_sweep": theta_sweep(),
        "w_obs_sweep": w_obs_sweep(),
    }


def target(studies: Studies, words: str) -> Target:
    (line,) = [line for line in evaluate_targets(studies) if words in line.text]
    return line


def test_the_papers_own_numbers_meet_every_target():
    lines = evaluate_targets(papers())
    assert len(lines) == 9
    assert {line.verdict for line in lines} == {MET}
    assert all(line.number != "-" for line in lines)


def test_without_results_no_target_is_tested():
    lines = evaluate_targets({})
    assert {line.verdict for line in lines} == {NOT_TESTED}
    assert {line.number for line in lines} == {"-"}


@pytest.mark.parametrize(
    ("study", "cells", "words", "number"),
    [
        ("table_1", table_1(hits=1), "in 0 of 200", "1 of 200 (0.5 %)"),
        ("table_1_long", table_1(2000, hits=11), "of 2000", "11 of 2000 (0.55 %)"),
        ("theta_sweep", theta_sweep(theta0=0.3), "CE-MPPI, paired", "clearance z = +"),
        ("theta_sweep", theta_sweep(theta0=0.3), "the paper's row", "clearance m 0.30 (z = +"),
        ("theta_sweep", theta_sweep(theta5=0.86), "flat", "0.800 to 0.860 m, 0.060 m apart"),
        ("w_obs_sweep", w_obs_sweep(10.5), "11 to 33 %", "10.5 to 10.5 %; not EKF-iLQG at 100"),
        ("w_obs_sweep", w_obs_sweep(33.5), "11 to 33 %", "33.5 to 33.5 %; not "),
        ("w_obs_sweep", w_obs_sweep(w500=1.0), "from w_obs = 500", "not MPPI-Belief at 500"),
        ("w_obs_sweep", w_obs_sweep(w10000=0.5), "from w_obs = 2500", "MPPI-Belief at 10000"),
    ],
)
def test_a_target_that_is_not_met_says_by_what_number(study, cells, words, number):
    line = target(papers() | {study: cells}, words)
    assert line.verdict == NOT_MET
    assert number in line.number


@pytest.mark.parametrize(
    ("study", "cells", "words"),
    [
        ("table_1", table_1(199), "in 0 of 200"),
        ("table_1_long", table_1(1999), "of 2000"),
        ("table_1", table_1()[1:], "fitted numbers"),
        ("table_1", table_1(199), "CE-MPPI, paired"),
        ("theta_sweep", theta_sweep()[1:], "the paper's row"),
        ("theta_sweep", theta_sweep()[:-1], "flat"),
        ("w_obs_sweep", w_obs_sweep(n=199), "11 to 33 %"),
        ("w_obs_sweep", w_obs_sweep()[:-1], "from w_obs = 2500"),
    ],
)
def test_a_target_waits_for_all_the_trials_that_it_speaks_of(study, cells, words):
    assert target(papers() | {study: cells}, words).verdict == NOT_TESTED


@pytest.mark.parametrize(("moved", "verdict"), [(2, MET), (3, NOT_MET)])
def test_twelve_of_the_fitted_numbers_are_enough(moved, verdict):
    cells = table_1()
    for index, (method, row) in enumerate([*published.TABLE_1.items()][:moved]):
        rows = trial_rows(200, row.collisions, (row.cost + 9.0, row.spread))
        cells[index] = results_of(cell_of(method), rows)
    line = target(papers() | {"table_1": cells}, "fitted numbers")
    assert (line.verdict, line.number) == (verdict, f"{14 - moved} of 14")


def test_cells_with_other_settings_test_nothing():
    others = {
        name: [cell._replace(departures=("cost.goal",)) for cell in cells]
        for name, cells in papers().items()
    }
    assert {line.verdict for line in evaluate_targets(others)} == {NOT_TESTED}


def test_a_paired_z_is_students_statistic(rng):
    first = rng.normal(1.0, 2.0, size=40)
    second = rng.normal(0.5, 1.0, size=40)
    assert paired_z(first, second) == pytest.approx(stats.ttest_rel(first, second).statistic)
    assert paired_z(first, first) == 0.0
    assert paired_z(np.ones(5), np.zeros(5)) == math.inf


def test_a_paired_z_of_collisions_is_mcnemars_but_for_one_part_in_n():
    first = np.repeat([1.0, 0.0, 1.0, 0.0], [30, 10, 80, 80])
    second = np.repeat([0.0, 1.0, 1.0, 0.0], [30, 10, 80, 80])
    mcnemar = (30 - 10) / math.sqrt(30 + 10)
    assert paired_z(first, second) == pytest.approx(mcnemar, rel=0.06)


def test_the_frame_has_a_line_per_target():
    frame = targets.targets_frame(evaluate_targets(papers()))
    assert list(frame.columns) == ["Target", "Verdict", "Here"]
    assert len(frame) == 9
