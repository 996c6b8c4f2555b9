"""The paper's conclusions: what they were tested on, where they fail, and what they wait for."""

from collections.abc import Sequence

import pytest

from mppi_belief.report import published
from mppi_belief.report.cell_results import CellResults
from mppi_belief.report.claims import judged_claims
from report_helpers import cell_of, failed_trial, results_of, trial_rows
from study_helpers import row

ABOVE = "Every baseline collides"
FREE = "No baseline is free"
BELOW = "MPPI-Belief collides in less"
ALL_WEIGHTS = "100, 250, 500, 1000, 2500, 5000, 10000"
RATES = {"ilqg": 20.0, "ce": 23.0, "pipf": 18.0}  # %, at every weight


def cells_of(method: str, rates: dict[float, float], n: int = 200) -> list[CellResults]:
    """A method over weights, with collision rates in %."""
    return [
        results_of(cell_of(method, w_obs=w_obs), trial_rows(n, round(n * rate / 100)))
        for w_obs, rate in rates.items()
    ]


def fig_2(n: int = 200, **changed: dict[float, float]) -> list[CellResults]:
    """The whole sweep, with other rates at some weights of some methods."""
    cells = []
    for method, rate in (RATES | {"belief": 0.0}).items():
        rates = dict.fromkeys(published.FIG_2_WEIGHTS, rate) | changed.get(method, {})
        cells += cells_of(method, rates, n)
    return cells


def claim(sentences: Sequence[str], start: str) -> str:
    (line,) = [line for line in sentences if line.startswith(start)]
    return line


def test_claims_that_hold_say_what_they_were_tested_on():
    table_1 = [results_of(cell_of(w_obs=300.0), trial_rows(200))]
    sentences = judged_claims(table_1, fig_2())
    assert len(sentences) == 4
    assert sentences[0] == (
        "MPPI-Belief at theta = 1 has 0 collisions in 200 trials; the paper has 0 in 200."
    )
    for start in (ABOVE, FREE):
        assert claim(sentences, start).endswith(
            ": holds for the rates observed, tested on 21 cells (EKF-iLQG, CE-MPPI and PIPF; "
            f"w_obs = {ALL_WEIGHTS}) with 200 trials each."
        )
    assert claim(sentences, BELOW).endswith(
        ": holds for the rates observed, tested on 5 cells (MPPI-Belief; w_obs = 500, 1000, 2500, "
        "5000, 10000) with 200 trials each."
    )


@pytest.mark.parametrize("weight", [100.0, 300.0, 500.0])
def test_a_claim_on_every_weight_does_not_hold_on_one(weight):
    """It is on the sweep that the claim fails."""
    one_weight = [cell for method in RATES for cell in cells_of(method, {weight: 40.0})]
    for sentences in (judged_claims(one_weight, []), judged_claims([], one_weight)):
        for start in (ABOVE, FREE, BELOW):
            assert ": not tested: needs 200 trials of " in claim(sentences, start)
            assert "holds" not in claim(sentences, start)
    at_the_end = fig_2(pipf={10000.0: 7.0})
    assert "fails for PIPF at w_obs = 10000 (7.0 %)" in claim(judged_claims([], at_the_end), ABOVE)


def test_a_claim_that_waits_names_what_it_needs():
    cells = [
        cell
        for cell in fig_2()
        if (cell.method, cell.labels["w_obs"])
        not in {("ce", 250.0), ("ce", 500.0), ("belief", 2500.0)}
    ]
    sentences = judged_claims([], cells)
    for start in (ABOVE, FREE):
        needs = ": not tested: needs 200 trials of CE-MPPI at w_obs = 250, 500."
        assert claim(sentences, start).endswith(needs)
    needs = ": not tested: needs 200 trials of MPPI-Belief at w_obs = 2500."
    assert claim(sentences, BELOW).endswith(needs)


def test_fewer_trials_than_the_papers_test_nothing():
    """None of 12 trials collides at a rate of 5 % more often than not."""
    sentences = judged_claims([], fig_2(12, ce={100.0: 0.0}))
    assert len(sentences) == 3
    assert all(": not tested: needs 200 trials of " in line for line in sentences)


def test_claims_name_exactly_the_cells_where_they_fail():
    cells = fig_2(
        ce={10000.0: 0.0},
        pipf={500.0: 10.0},  # not more than 10 %
        belief={100.0: 50.0, 500.0: 1.0, 2500.0: 2.5},
    )
    sentences = judged_claims([], cells)
    where = "CE-MPPI at w_obs = 10000 (0.0 %)"
    assert f": fails for {where} and PIPF at w_obs = 500 (10.0 %); tested on 21 cells" in claim(
        sentences, ABOVE
    )
    assert f": fails for {where}; tested on 21 cells" in claim(sentences, FREE)
    assert (
        ": fails for MPPI-Belief at w_obs = 500 (1.0 %) and MPPI-Belief at w_obs = 2500 (2.5 %); "
        in claim(sentences, BELOW)
    )


def test_one_exception_refutes_a_claim_whatever_else_is_missing():
    (line,) = [
        line for line in judged_claims([], cells_of("ce", {100.0: 0.0})) if line.startswith(FREE)
    ]
    assert ": fails for CE-MPPI at w_obs = 100 (0.0 %); tested on 1 cell (CE-MPPI; " in line
    assert (
        f"; not tested: 200 trials of EKF-iLQG and PIPF at w_obs = {ALL_WEIGHTS}; CE-MPPI at"
        in line
    )


def test_collisions_are_counted_in_singular_and_plural():
    for hits, words in ((0, "0 collisions"), (1, "1 collision in"), (2, "2 collisions")):
        (line, *_) = judged_claims([results_of(cell_of(), trial_rows(200, hits))], [])
        assert words in line
    (line, *_) = judged_claims([results_of(cell_of(), [row(0), failed_trial(1)])], [])
    assert "0 collisions in 1 trial;" in line


def test_cells_with_other_settings_or_of_other_methods_test_nothing():
    assert judged_claims([], []) == []
    boats = [cell._replace(departures=None) for cell in fig_2()]
    other_goal = [cell._replace(departures=("cost.goal", "cost.w_obs")) for cell in fig_2()]
    for cells in (boats, other_goal):
        assert judged_claims(cells, cells) == []
    varied = [cell._replace(departures=("cost.w_obs",)) for cell in fig_2()]
    assert judged_claims([], varied) == judged_claims([], fig_2())
    assert judged_claims([results_of(cell_of(), [failed_trial(0)])], []) == []
    lines = judged_claims([results_of(cell_of("oracle"), trial_rows(200, 0))], [])
    assert not [line for line in lines if "holds" in line or "fails" in line]
