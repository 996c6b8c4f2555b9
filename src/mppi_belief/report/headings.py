"""The title and the lead of the page: the paper's for the paper's studies, else the study's own."""

from collections.abc import Collection, Sequence
from typing import NamedTuple

from ..errors import counted
from .reported_study import ReportedStudy
from .wording import count_range, listed

PAPER_TITLE = "Path integral control in Gaussian belief space: the experiments reproduced"
PAPER_LEAD = (
    "Das and Tanaka plan in the space of Gaussian beliefs and report a vehicle that never "
    "collides, while three baselines do. This page shows their experiments, repeated with this "
    "package, beside the numbers of the paper."
)
FURTHER_TITLE = "Path integral control in Gaussian belief space: beyond the paper"
FURTHER_LEAD = (
    "These studies go beyond the experiments of Das and Tanaka: other problems, filters and "
    "samplers, planned for with the same package. The paper has no numbers for them."
)


class Heading(NamedTuple):
    """Holds the title and the lead of the page."""

    title: str
    lead: str


def page_heading(studies: Sequence[ReportedStudy], papers: Collection[str]) -> Heading:
    """Returns the heading of a page of some studies; `papers` names those of the paper."""
    own = [study for study in studies if study.is_own]
    if not own and all(study.name in papers for study in studies):
        return Heading(PAPER_TITLE, PAPER_LEAD)
    if not own and not any(study.name in papers for study in studies):
        return Heading(FURTHER_TITLE, FURTHER_LEAD)
    if len(studies) == 1:
        return Heading(own[0].title, f"{own[0].question} {_contents(own[0])}".strip())
    titles = [study.title if study.is_own else study.name for study in studies]
    lead = f"This page shows {len(studies)} studies."
    return Heading(listed(titles), lead)


def _contents(study: ReportedStudy) -> str:
    """Says how many cells and trials a page of one study shows, and what runs them."""
    distinct = {cell.id: cell for cell in study.cells}.values()
    trials = count_range(cell.config["n_trials"] for cell in distinct)
    each = " each" if len(distinct) > 1 else ""
    noun = "trial" if trials == "1" else "trials"
    cells = counted(len(distinct), "cell")
    return f"This page shows {cells} with {trials} {noun}{each}, run by `{study.command}`."
