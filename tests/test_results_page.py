"""docs/results.md: every number of ours stands in a block that a function or a table writes."""

import re
from pathlib import Path
from typing import Any

import pytest

import results_blocks
import results_page
from mppi_belief.config.cell import Cell
from mppi_belief.report import published
from mppi_belief.report.cell_results import CellResults, Studies
from mppi_belief.report.page import PageTable, Section
from report_helpers import cell_of, results_of, trial_rows
from results_blocks import SENTENCES, PageSources

TEXT = results_page.PAGE.read_text(encoding="utf-8")
REPORT = Path(results_page.build.__file__).parent

# Numbers that stand on the page by hand, beside those of the paper.
NOT_OURS = {
    "1.5",  # the factor between the clock speeds of a machine
    "4.49",  # the plan of least published cost, Platt et al.: docs/beyond/published_problems.md
    "0.42",
    "4.99",  # the same, van den Berg et al.
    "0.01",
}


def papers_numbers() -> set[str]:
    """Returns the numbers with a decimal point that the paper prints, as the page writes them."""
    numbers = {f"{published.RESIDUAL:g}"}
    for row in published.TABLE_1.values():
        rate = 100 * row.collisions / published.PAPER_TRIALS
        numbers |= {f"{row.cost}", f"{row.spread}", f"{rate:.1f}"}
    for theta, row in published.PAPER_THETA.items():
        numbers |= {f"{theta:.1f}", *(f"{100 * rate:.1f}" for rate in row.collision_rate)}
        numbers |= {f"{row.clearance or 0:.2f}", f"{row.cost or 0}"}
    return numbers


def test_no_measured_number_is_written_by_hand():
    by_hand = re.sub(r"\]\([^)]*\)", "]", results_page.without_blocks(TEXT))
    decimals = set(re.findall(r"\d+\.\d+", by_hand))
    assert decimals <= papers_numbers() | NOT_OURS
    rates = set(re.findall(r"(\d+(?:\.\d+)?) %", by_hand))
    assert rates <= {"1", "33", "1.5", "2.5", "23.0"}  # the paper's


def test_every_block_has_a_producer():
    sources = "".join(path.read_text() for path in REPORT.rglob("*.py"))
    for name in results_page.block_names(TEXT):
        stem = re.sub("_(fitted|held_out|differences|scalar_linear)$", "_", name)
        assert name in SENTENCES or f'"{name}"' in sources or f'"{stem}' in sources, name


def test_every_sentence_is_on_the_page_once():
    names = results_page.block_names(TEXT)
    assert len(set(names)) == len(names)
    assert SENTENCES.keys() <= set(names)


def test_blocks_are_filled_and_the_rest_stays():
    page = "a\n<!-- report: one -->\nold\n<!-- end -->\nb\n<!-- report: two -->\n<!-- end -->\n"
    new = results_page.filled(page, {"one": "1\n", "two": "2", "three": "3"})
    first_block = "<!-- report: one -->\n\n1\n\n<!-- end -->"
    second_block = "<!-- report: two -->\n\n2\n\n<!-- end -->"
    assert new == f"a\n{first_block}\nb\n{second_block}\n"
    assert results_page.filled(new, {"one": "1", "two": "2"}) == new
    assert results_page.without_blocks(new) == "a\n\nb\n\n"
    with pytest.raises(SystemExit, match="two"):
        results_page.filled(page, {"one": "1"})


def with_run(cell: Cell, rows: list[dict[str, Any]]) -> CellResults:
    """Returns results that say where they come from."""
    source = {
        "started": "2026-11-30T22:32:19+00:00",
        "commit": "be0cc50aaaa",
        "processor": "a processor",
        "versions": {"python": "3.11.7", "jax": "0.10.2"},
    }
    return results_of(cell, rows, sources=[source])


def studies() -> Studies:
    """Returns the paper's studies with the paper's own numbers, or nearly."""
    table_1 = [
        with_run(cell_of(method), trial_rows(200, row.collisions, (row.cost, row.spread)))
        for method, row in published.TABLE_1.items()
    ]
    weights = []
    for w_obs in published.FIG_2_WEIGHTS:
        for method in published.TABLE_1:
            hits = 0 if method == "belief" else 40
            weights.append(with_run(cell_of(method, w_obs=w_obs), trial_rows(200, hits)))
    theta = [with_run(cell_of(theta=value), trial_rows(200, 46)) for value in published.PAPER_THETA]
    expectation = [
        with_run(cell_of(theta=0.0, **{published.EXPECTATION_KEY: rule}), trial_rows(200, 46))
        for rule in ("exact", "at_mean")
    ]
    return {
        "table_1": table_1,
        "table_1_long": table_1,
        "theta_sweep": theta,
        "w_obs_sweep": weights,
        "expectation": expectation,
    }


def test_sentences_are_written_from_the_results():
    """Checks all blocks whose studies are among the made-up ones."""
    sections = [Section("The matching residual", ["A residual of 0.5."])]
    written = results_page.block_contents(PageSources(studies(), sections))
    contents = {name: text.replace("\n", " ") for name, text in written.items()}
    assert contents["matching_residual"] == "A residual of 0.5."
    run = "run on 30 November 2026 at commit be0cc50, on a processor, with Python 3.11.7"
    assert run in contents["origin"]
    assert "in 0.0 [0.0, 1.8] % of 200 trials" in contents["summary"]
    assert "the baselines in 18.0 to 24.5 % of 200" in contents["summary"]
    assert contents["agreement"].startswith("12 of the 14 fitted numbers agree")
    assert contents["claims"].count(" - ") == 3
    assert "| CE-MPPI | 20.0 (50.0) |" in contents["weights"]
    assert "23.0 %, 0.50 m and 50.0 with" in contents["neutral"]
    assert "for CE-MPPI (the paper: 13)" in contents["times"]
    assert "quality" not in contents  # there are no results of its study
    lines = written["summary"].splitlines()
    assert max(len(line) for line in lines) <= results_blocks.WIDTH


def test_a_section_that_is_absent_gives_no_content():
    contents = results_page.block_contents(PageSources(studies(), []))
    assert "matching_residual" not in contents


def test_a_percent_sign_stays_with_its_number():
    lines = results_blocks.paragraph(*["of 36.0 %"] * 60).splitlines()
    assert len(lines) > 1
    assert not any(line.startswith("%") for line in lines)


@pytest.mark.parametrize("busy", [False, True])
def test_a_mark_of_busy_times_is_explained_under_the_table(busy):
    frame = results_blocks.pd.DataFrame({"Time": ["1.0*"]})
    caption = f"Table I. {results_page.BUSY_NOTE}" if busy else "Table I"
    content = results_page.table_content(PageTable("table_1", caption, frame))
    assert ("measures it again" in content) == busy
