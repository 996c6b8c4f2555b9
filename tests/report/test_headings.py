"""The title and lead of a page: the paper's for the paper's studies only."""

from typing import Any

from mppi_belief.report.headings import (
    FURTHER_LEAD,
    FURTHER_TITLE,
    PAPER_LEAD,
    PAPER_TITLE,
    page_heading,
)
from mppi_belief.report.reported_study import ReportedStudy
from report_helpers import cell_of

PAPERS = ("table_1", "theta_sweep")


def study(name: str, **changes: Any) -> ReportedStudy:
    cell = cell_of()
    config = cell.config | {"n_trials": 20}
    fields = {"words": (f"experiment={name}",), "overrides": (), "is_own": False, "stem": name}
    fields |= {"title": name, "question": ""} | changes
    return ReportedStudy(name=name, cells=[cell._replace(config=config)], **fields)


def test_the_papers_studies_have_the_papers_title():
    assert page_heading([study("table_1")], PAPERS) == (PAPER_TITLE, PAPER_LEAD)
    assert page_heading([study("table_1"), study("theta_sweep")], PAPERS)[0] == PAPER_TITLE


def test_studies_beyond_the_paper_do_not():
    assert page_heading([study("two_lanes")], PAPERS) == (FURTHER_TITLE, FURTHER_LEAD)


def test_a_users_study_has_its_own_title_question_and_command():
    own = study("crossing", is_own=True, title="Crossing", question="Who crosses?")
    heading = page_heading([own], PAPERS)
    assert heading.title == "Crossing"
    command = "`mppi-belief run experiment=crossing`"
    assert heading.lead == f"Who crosses? This page shows 1 cell with 20 trials, run by {command}."
    without = page_heading([own._replace(question="")], PAPERS)
    assert without.lead.startswith("This page shows 1 cell")


def test_the_papers_name_with_other_settings_is_a_users_study():
    changed = study("table_1", is_own=True, title="table_1 with problem.steps=40")
    assert page_heading([changed], PAPERS).title == "table_1 with problem.steps=40"


def test_a_mixed_page_names_its_studies():
    own = study("crossing", is_own=True, title="Crossing")
    heading = page_heading([study("table_1"), own], PAPERS)
    assert heading == ("table_1 and Crossing", "This page shows 2 studies.")
