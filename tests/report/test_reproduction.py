"""Published numbers against ours: each number once, z by hand, claims with their exceptions."""

import math
import re
from collections.abc import Sequence

import pytest

from mppi_belief.report.agreement import (
    AGREEMENT,
    FITTED,
    HELD_OUT,
    ComparedNumber,
    compare_numbers,
)
from mppi_belief.report.cell_results import CellResults
from mppi_belief.report.sections.reproduction import (
    compared_frame,
    multiplicity_verdict,
    reproduction_sections,
    verdict,
)
from mppi_belief.report.statistics import holm_adjusted, two_sided_p
from report_helpers import cell_of, failed_trial, results_of, trial_rows

TABLE_1 = {  # cost, spread, collisions in %, as printed
    "ilqg": ("EKF-iLQG", 46.1, 6.2, 24.5),
    "ce": ("CE-MPPI", 50.5, 6.2, 23.0),
    "pipf": ("PIPF", 47.6, 5.5, 18.0),
    "belief": ("MPPI-Belief", 56.5, 5.2, 0.0),
}
THETA = {0.0: (23.0, 0.11, 51.3), 0.5: (2.5, 0.80, None), 1.0: (0.0, 0.82, 56.6)}  # %, m, cost
WEIGHTS = (100.0, 250.0, 500.0, 1000.0, 2500.0, 5000.0, 10000.0)


def likelihood_ratio(hits: int, n: int, published_hits: float, m: int) -> float:
    """The signed root, 0 log 0 = 0."""

    def log_likelihood(k: float, of: int, p: float) -> float:
        return (k * math.log(p) if k else 0.0) + ((of - k) * math.log(1 - p) if of > k else 0.0)

    pooled = (hits + published_hits) / (n + m)
    two = log_likelihood(hits, n, hits / n) + log_likelihood(published_hits, m, published_hits / m)
    pooled_value = log_likelihood(hits, n, pooled) + log_likelihood(published_hits, m, pooled)
    return math.copysign(
        math.sqrt(max(0.0, 2 * (two - pooled_value))), hits / n - published_hits / m
    )


def table_1(n: int = 200, **hits: int) -> list[CellResults]:
    """The four methods with the paper's own costs and, if nothing else is said, its collisions."""
    return [
        results_of(
            cell_of(method), trial_rows(n, hits.get(method, round(n * rate / 100)), (cost, sd))
        )
        for method, (_, cost, sd, rate) in TABLE_1.items()
    ]


def sweep(method: str, rates: dict[float, float], n: int = 200) -> list[CellResults]:
    """A method over weights, with collision rates in %."""
    return [
        results_of(cell_of(method, w_obs=w_obs), trial_rows(n, round(n * rate / 100)))
        for w_obs, rate in rates.items()
    ]


def weights() -> list[CellResults]:
    """Returns the obstacle-weight sweep as the paper describes it."""
    baselines = []
    for method in ("ilqg", "ce", "pipf"):
        baselines += sweep(method, dict.fromkeys(WEIGHTS, 20.0))
    return baselines + sweep(
        "belief",
        {100.0: 9.0, 250.0: 4.0, 500.0: 0.5, 1000.0: 0.5} | dict.fromkeys(WEIGHTS[4:], 0.0),
    )


def thetas() -> list[CellResults]:
    measured = {
        0.0: (46, 0.11, 51.3),
        0.5: (5, 0.80, 54.0),
        1.0: (0, 0.82, 56.6),
        2.0: (2, 0.9, 60.0),
        5.0: (1, 0.9, 70.0),
    }
    return [
        results_of(cell_of(theta=theta), trial_rows(200, hits, (cost, 5.0), (clearance, 0.1)))
        for theta, (hits, clearance, cost) in measured.items()
    ]


def by_name(lines: Sequence[ComparedNumber]) -> dict[str, ComparedNumber]:
    return {line.label: line for line in lines}


def test_every_published_number_is_there_once_and_fitted_numbers_are_those_of_table_1():
    lines = compare_numbers(table_1(), thetas(), weights())
    assert len({line.label for line in lines}) == len(lines)
    fitted = {(line.label, line.paper) for line in lines if line.kind == FITTED}
    expected = set()
    for name, cost, sd, rate in TABLE_1.values():
        expected |= {(f"{name}, cost", f"{cost}"), (f"{name}, spread of the cost", f"{sd}")}
        expected |= {(f"{name}, collisions %", f"{rate:.1f}")}
    expected |= {
        ("theta 1, cost", "56.6"),
        ("theta 1, collisions %", "0.0"),
    }  # Table I's cell again
    assert fitted == expected
    predicted = {(line.label, line.paper) for line in lines if line.kind == HELD_OUT}
    expected = {(f"theta {theta}, collisions %", "0.5 to 1.5") for theta in (2, 5)}
    for theta, (rate, clearance, cost) in THETA.items():
        expected.add((f"theta {theta:g}, clearance m", f"{clearance:.2f}"))
        expected |= {(f"theta {theta:g}, collisions %", f"{rate:.1f}")} if theta != 1 else set()
        expected |= {(f"theta {theta:g}, cost", f"{cost}")} if cost and theta != 1 else set()
    for w_obs in WEIGHTS:
        expected |= {
            (f"w_obs {w_obs:g}, {TABLE_1[name][0]}, collisions %", "11 to 33")
            for name in ("ilqg", "ce", "pipf")
        }
    for w_obs in WEIGHTS[2:]:
        paper = "0 to 1" if w_obs < 2500 else "0.0"
        expected.add((f"w_obs {w_obs:g}, MPPI-Belief, collisions %", paper))
    assert predicted == expected
    assert len(lines) == len(fitted) + len(predicted)


def test_the_papers_own_numbers_agree_with_themselves():
    for line in compare_numbers(table_1(), thetas(), weights()):
        assert abs(line.z) < 1e-6, line
        assert line.paper == line.ours or " to " in line.paper
    lines = compare_numbers(table_1(), thetas(), weights())
    assert verdict(lines, FITTED).startswith(
        "14 of the 14 fitted numbers agree within 2 standard errors; "
    )
    ranges = sum(" to " in line.paper for line in lines)
    points = len(lines) - 14 - ranges
    start_of_verdict = (
        f"{points} of the {points} held-out numbers agree within 2 standard errors, "
        f"and {ranges} of {ranges} ranges"
    )
    assert verdict(lines, HELD_OUT).startswith(start_of_verdict)


def test_z_of_table_1_by_hand():
    """Takes 50 trials of mean 58, spread 4 and 3 collisions against 56.5, 5.2 and none."""
    measured = results_of(
        cell_of(), [*trial_rows(50, 3, (58.0, 4.0)), failed_trial(50), failed_trial(51)]
    )
    cost, spread, rate = compare_numbers([measured], [], [])
    assert cost.z == pytest.approx(1.5 / math.sqrt(16 / 50 + 5.2**2 / 200), rel=1e-9)
    assert spread.z == pytest.approx(-1.2 / math.sqrt(16 / 98 + 5.2**2 / 398), rel=1e-9)
    assert rate.z == pytest.approx(likelihood_ratio(3, 50, 0, 200), rel=1e-9)
    assert [line.ours for line in (cost, spread, rate)] == ["58.0", "4.0", "6.0"]


def test_z_of_the_theta_sweep_by_hand():
    """Where the paper prints no spread, both sides have ours."""
    measured = results_of(cell_of(theta=0.0), trial_rows(100, 30, (50.0, 6.0), (0.2, 0.3)))
    lines = by_name(compare_numbers([], [measured], []))
    both = math.sqrt(1 / 100 + 1 / 200)
    assert lines["theta 0, clearance m"].z == pytest.approx(0.09 / (0.3 * both), rel=1e-9)
    assert lines["theta 0, cost"].z == pytest.approx(-1.3 / (6 * both), rel=1e-9)
    assert lines["theta 0, collisions %"].z == pytest.approx(
        likelihood_ratio(30, 100, 46, 200), rel=1e-9
    )
    assert len(lines) == 3


@pytest.mark.parametrize(
    ("method", "w_obs", "hits", "end"),
    [
        ("ce", 100.0, 22, None),  # 11 %, the lower end
        ("ce", 100.0, 66, None),
        ("ce", 100.0, 40, None),
        ("ce", 100.0, 10, 0.11),
        ("pipf", 1e4, 90, 0.33),
        ("belief", 500.0, 2, None),
        ("belief", 500.0, 8, 0.01),
        ("belief", 2500.0, 0, None),
        ("belief", 2500.0, 2, 0.0),
    ],
)
def test_within_a_range_z_is_zero_and_outside_it_counts_from_the_nearest_end(
    method, w_obs, hits, end
):
    (line,) = compare_numbers([], [], sweep(method, {w_obs: hits / 2}))
    expected = 0.0 if end is None else likelihood_ratio(hits, 200, 200 * end, 200)
    assert line.z == pytest.approx(expected, rel=1e-6, abs=1e-6)
    assert (line.z == pytest.approx(0, abs=1e-6)) == (end is None)


def test_where_the_paper_says_nothing_nothing_is_compared():
    assert compare_numbers([], [], sweep("belief", {100.0: 1.0, 250.0: 1.0})) == []
    assert compare_numbers([], [results_of(cell_of(theta=0.25), trial_rows(9))], []) == []
    assert (
        compare_numbers(
            [results_of(cell_of("oracle"), trial_rows(9))], [], sweep("oracle", {500.0: 0.0})
        )
        == []
    )


def test_cells_without_at_least_two_good_trials_are_left_out():
    few = [[], trial_rows(1), [*trial_rows(1), failed_trial(1), failed_trial(2)]]
    for rows in few:
        assert (
            compare_numbers(
                [results_of(cell_of(), rows, 5)],
                [results_of(cell_of(), rows, 5)],
                [results_of(cell_of(), rows, 5)],
            )
            == []
        )
    assert len(compare_numbers([results_of(cell_of(), trial_rows(2))], [], [])) == 3


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("clearance", [0.3, math.inf], ids=["equal trials", "no obstacles"])
def test_trials_without_a_spread_do_not_stop_a_report(clearance):
    rows = trial_rows(5, 0, (50.0, 0.0), (clearance, 0.0))
    lines = [
        *compare_numbers([results_of(cell_of(), rows)], [], []),
        *compare_numbers([], [results_of(cell_of(theta=0.0), rows)], []),
    ]
    assert [line.label for line in lines if "clearance" in line.label] == ["theta 0, clearance m"]
    for kind in (FITTED, HELD_OUT):
        assert len(compared_frame(lines, kind)) == 3
        assert re.search("numbers? agrees? within", verdict(lines, kind))


def test_the_frame_has_the_lines_of_one_kind():
    lines = [
        ComparedNumber(FITTED, "a", "1.0", "2.0", 1.26, p=0.415),
        ComparedNumber(HELD_OUT, "b", "3", "4", -0.5),
        ComparedNumber(FITTED, "c", "5", "6", math.nan),
    ]
    frame = compared_frame(lines, FITTED)
    assert frame.to_numpy().tolist() == [
        ["a", "1.0", "2.0", "+1.3", "0.41"],
        ["c", "5", "6", "-", "-"],
    ]
    assert compared_frame(lines, HELD_OUT).to_numpy().tolist() == [["b", "3", "4", "-0.5", "-"]]
    assert compared_frame([], FITTED).empty


def test_the_verdict_counts_and_names_the_farthest():
    z = [0.1, -1.9, 2.0, -2.1, 7.0, -9.5, math.nan]
    lines = [
        ComparedNumber(FITTED, f"number {k}", f"{k}.5", f"{k}.7", value)
        for k, value in enumerate(z)
    ]
    lines.append(ComparedNumber(HELD_OUT, "another", "1", "2", 99.0))
    start_of_verdict = verdict(lines, FITTED)
    assert start_of_verdict.startswith("3 of the 6 fitted numbers agree within 2 standard errors")
    assert "the farthest is number 5: 5.7 here, 5.5 in the paper (z = -9.5)" in start_of_verdict
    assert verdict(lines[:6], HELD_OUT) == "None of the held-out numbers has results yet."
    assert verdict(lines[6:7], FITTED) == "None of the fitted numbers has results yet."


def test_ranges_are_counted_apart():
    lines = [
        ComparedNumber(HELD_OUT, "a", "1", "9", 5.0),
        ComparedNumber(HELD_OUT, "b", "1", "1", 0.0),
    ]
    lines += [
        ComparedNumber(HELD_OUT, f"c{z}", "1 to 2", "2", z, is_range=True) for z in (0.0, 0.0, 3.0)
    ]
    start_of_verdict = (
        "1 of the 2 held-out numbers agrees within 2 standard errors, and 2 of 3 ranges met; "
    )
    assert verdict(lines, HELD_OUT).startswith(start_of_verdict)


def test_p_values_are_adjusted_for_all_comparisons_of_the_page():
    lines = compare_numbers(table_1(belief=9), thetas(), weights())
    expected = holm_adjusted([two_sided_p(line.z) for line in lines])
    assert [line.p for line in lines] == expected
    (collisions,) = [line for line in lines if line.label == "MPPI-Belief, collisions %"]
    z = likelihood_ratio(9, 200, 0, 200)
    # All other comparisons agree, so this is the smallest of all p-values.
    assert collisions.p == pytest.approx(len(lines) * math.erfc(z / math.sqrt(2)), rel=1e-6)


def test_what_so_many_comparisons_mean_is_said():
    z = [2.5, -1.0, 0.3, 9.0, *[0.0] * 44]
    adjusted = holm_adjusted([two_sided_p(value) for value in z])
    lines = [
        ComparedNumber(FITTED, f"number {k}", "1", "2", value, p=p)
        for k, (value, p) in enumerate(zip(z, adjusted, strict=True))
    ]
    text = multiplicity_verdict(lines)
    assert text.startswith("Of 48 comparisons 2 lie beyond 2 standard errors; at most 2.2 would")
    assert "number 3 (p = " in text
    assert "number 0" not in text  # 48 such numbers would hold one or two by chance
    assert multiplicity_verdict(lines[1:3]).endswith("no number differs.")


@pytest.mark.parametrize("departures", [None, ("cost.goal",), ("system._target_",)])
def test_other_problems_are_not_compared_with_the_paper(departures, tmp_path):
    """A boat has MPPI-Belief, a theta and a weight, too."""
    others = [
        [cell._replace(departures=departures) for cell in cells]
        for cells in (table_1(), thetas(), weights())
    ]
    assert compare_numbers(*others) == []
    studies = dict(zip(("table_1", "theta_sweep", "w_obs_sweep"), others, strict=True))
    assert reproduction_sections(studies, tmp_path) == []


def test_each_sweep_may_vary_its_own_key_and_no_other():
    theta = ("controller.path_cost.theta",)
    weight = ("cost.w_obs",)
    moved = [[cell._replace(departures=theta) for cell in thetas()]]
    moved.append([cell._replace(departures=weight) for cell in weights()])
    assert compare_numbers([], *moved) == compare_numbers([], thetas(), weights())
    assert compare_numbers(moved[0], moved[1], moved[0]) == []


def test_a_weight_outside_the_papers_range_is_not_compared():
    assert compare_numbers([], [], sweep("ce", {30.0: 50.0, 20000.0: 5.0})) == []


def test_agreement_is_within_two_standard_errors():
    assert AGREEMENT == 2
