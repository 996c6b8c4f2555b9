"""The report's section on proposals, from made-up results."""

import pytest

from mppi_belief.report import figures
from mppi_belief.report.cell_results import CellResults
from mppi_belief.report.sections import study_sections
from mppi_belief.report.sections.proposals import proposal_pairs, sample_saving
from report_helpers import cell_of, results_of, trial_rows


def timed_cell(
    proposal: str, samples: int, cost: float, ess: float, method: str = "belief", **more
) -> CellResults:
    """Twenty trials of a cell that takes a millisecond for a hundred samples."""
    swept = {"sampler": proposal, "planner.n_samples": samples}
    cell = cell_of(method, **more, **swept)
    cell = cell._replace(
        config=cell.config | {"controller": cell.config["controller"] | {"n_samples": samples}}
    )
    rows = [cell_item | {"ess": ess} for cell_item in trial_rows(20, 1, (cost, 5.0 + ess / 500))]
    return results_of(cell, rows)._replace(seconds=[samples / 1e5] * 20)


def study() -> list[CellResults]:
    return [
        timed_cell("nominal", 50, 100.0, 2.0),
        timed_cell("nominal", 500, 57.0, 10.0),
        timed_cell("laplace", 20, 60.0, 19.0),
        timed_cell("laplace", 50, 53.0, 46.0),
        timed_cell("laplace", 500, 52.0, 460.0),
        timed_cell("nominal", 50, 40.0, 4.0, "ce", theta=float("nan")),
        timed_cell("laplace", 50, 41.0, 48.0, "ce", theta=float("nan")),
        timed_cell("nominal", 50, 70.0, 1.0, w_obs=2500.0),
        timed_cell("laplace", 50, 60.0, 30.0, w_obs=2500.0),
    ]


def test_cells_are_compared_that_differ_in_the_proposal_alone():
    cells = study()
    assert [(cells.index(a), cells.index(b)) for a, b in proposal_pairs(cells)] == [
        (0, 3),
        (1, 4),
        (5, 6),
        (7, 8),
    ]


def test_the_fewest_samples_are_found_that_cost_no_more():
    most, fewest, less = sample_saving(study()[:5], "belief")
    assert (most.samples, fewest.samples) == (500, 50)
    assert less.value == pytest.approx(4.0)
    assert sample_saving(study()[:3], "belief") is None
    assert sample_saving(study()[2:5], "belief") is None


def test_the_section_tells_both_and_draws_the_usual_scenario(tmp_path):
    (section,) = study_sections({"proposals": study()}, tmp_path)
    assert "the effective sample size is 12 to 46 times that about the nominal." in section.text[1]
    assert "MPPI-Belief with 50 samples from it costs 4.00 [" in section.text[1]
    assert (
        "less than with 500 samples about the nominal, in 0.50 ms per step instead of 5.00."
        in section.text[1]
    )
    frame = section.tables[0].frame
    assert list(frame["ESS/ms"][:4]) == ["4", "2", "95", "92"]
    assert set(frame["system"]) == {study()[0].cell.config["names"]["system"]}
    assert (tmp_path / "proposals.png").stat().st_size > 0
    axes = figures.proposals_figure(study()[:5]).axes[0]
    lines = {line.get_label(): line for line in axes.containers}
    assert list(lines) == ["MPPI-Belief, laplace", "MPPI-Belief, nominal"]
    assert list(lines["MPPI-Belief, laplace"][0].get_xdata()) == [0.2, 0.5, 5.0]


def test_without_times_nothing_is_drawn(tmp_path):
    untimed = [cell_item._replace(seconds=[]) for cell_item in study()]
    (section,) = study_sections({"proposals": untimed}, tmp_path)
    assert section.pictures == []
    assert set(section.tables[0].frame["ESS/ms"]) == {"-"}
