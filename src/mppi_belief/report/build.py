"""Builds the report of studies: tables and figures as files, and one page with all of them."""

import itertools
import shlex
import sys
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import NamedTuple

from ..config.request import key_of
from ..errors import counted
from ..results.certificate import CERTIFICATE_NAMES
from ..results.certificate_files import StoredCertificate, load_certificates
from .cell_results import CellResults, failure_kinds, read_cell_results
from .elements import any_busy, cell_lines
from .frame_files import write_text_file
from .headings import page_heading
from .origin import trial_provenance, trial_warnings
from .page import Page, render
from .paper_settings import Configuration, table_1_departures
from .reported_study import ReportedStudy
from .sections import (
    FURTHER_STUDIES,
    PAPER_STUDIES,
    SUPPLEMENTS,
    own_sections,
    study_sections,
)
from .sections.own_study import OwnStudy
from .sections.table_1 import table_1_frame
from .sections.theory import theory_provenance, theory_sections, theory_warnings
from .summary import BUSY_NOTE

INDEX_HTML = "index.html"
STUDIES = tuple(PAPER_STUDIES)  # of a report that is not asked for others
SUPPLEMENTARY = tuple(SUPPLEMENTS)  # of such a report, where they have results
SECTIONS = (
    *PAPER_STUDIES,
    *FURTHER_STUDIES,
    *SUPPLEMENTS,
)  # studies whose sections say what they show


def report_studies(
    studies: Sequence[ReportedStudy],
    table_1: Sequence[Configuration],
    verify_dir: Path | None,
    folder: Path,
    supplements: Collection[str] = (),
) -> bool:
    """Writes the report of some studies into `folder`; returns whether it is complete.

    Reads the results of the studies' cells and, unless `verify_dir` is None, the certificates.
    `table_1` are the configurations of the paper's Table I; numbers of the paper are shown beside
    cells with their settings only. Prints tables, warnings, and for whatever is missing the command
    that runs it; to stderr an example of each kind of failed trial. Of the studies that
    `supplements` names it shows those that have results, and misses none.
    """
    warnings: dict[str, None] = {}  # cells that two studies share warn once
    results = [read_study(study, table_1, warnings.setdefault) for study in studies]
    results = [
        study
        for study in results
        if study.study.name not in supplements or any(len(cell.rows) for cell in study.cells)
    ]
    certificates = [] if verify_dir is None else load_certificates(verify_dir)
    page = write_report(results, certificates, folder, list(warnings))

    for study in results:
        _print_table(study)
    cells = _distinct_cells(results)
    if any_busy(cells):
        print(BUSY_NOTE)
    for kind in itertools.chain.from_iterable(map(failure_kinds, cells)):
        print(kind.line, file=sys.stderr)
    missing = missing_lines([study for study in results if study.study.name not in supplements])
    if verify_dir is not None and len(certificates) < len(CERTIFICATE_NAMES):
        missing.append(_missing_certificates(len(certificates), studies[0].overrides))
    for line in [*warnings, *theory_warnings(certificates), *missing]:
        print(line)
    print(f"report: {page}")
    return not missing


class StudyResults(NamedTuple):
    """Holds a study with the results of its distinct cells."""

    study: ReportedStudy
    cells: list[CellResults]


def read_study(
    study: ReportedStudy, table_1: Sequence[Configuration], warn: Callable[[str], object]
) -> StudyResults:
    """Reads the results of each distinct cell of a study."""
    cells = []
    for cell in {cell.id: cell for cell in study.cells}.values():
        root = Path(cell.config["results_dir"])
        results = read_cell_results(cell, root, cell.config["n_trials"], warn)
        departures = None if study.is_own else table_1_departures(cell.config, table_1)
        cells.append(results._replace(departures=departures))
    return StudyResults(study, cells)


def _distinct_cells(studies: Sequence[StudyResults]) -> list[CellResults]:
    """Returns the cells of all studies, those that two studies share once."""
    return list({cell.id: cell for study in studies for cell in study.cells}.values())


def _print_table(results: StudyResults) -> None:
    """Prints Table I, or the cells of a study of one's own."""
    if not any(len(cell.good) for cell in results.cells):
        return
    if results.study.is_own:
        print(cell_lines(results.cells).to_string(index=False))
    elif results.study.name == "table_1":
        print(table_1_frame(results.cells).to_string(index=False))


def write_report(
    studies: Sequence[StudyResults],
    certificates: Sequence[StoredCertificate],
    folder: Path,
    warnings: Sequence[str],
) -> Path:
    """Writes the page and its tables and figures into `folder`; returns the path of the page.

    `warnings` are shown on the page, after those about the trials and the certificates.
    """
    folder.mkdir(parents=True, exist_ok=True)
    cells = _distinct_cells(studies)
    known = {results.study.name: results.cells for results in studies if not results.study.is_own}
    own = [
        OwnStudy(results.study.stem, results.study.title, results.cells)
        for results in studies
        if results.study.is_own
    ]
    heading = page_heading([results.study for results in studies], {*PAPER_STUDIES, *SUPPLEMENTS})
    page = Page(
        title=heading.title,
        lead=heading.lead,
        warnings=[*trial_warnings(cells), *theory_warnings(certificates), *warnings],
        sections=[
            *study_sections(known, folder),
            *own_sections(own, folder, alone=len(studies) == 1),
            *theory_sections(certificates, folder),
        ],
        provenance=[*trial_provenance(cells), *theory_provenance(certificates)],
    )
    write_text_file(folder / INDEX_HTML, render(page, folder))
    return folder / INDEX_HTML


def missing_lines(studies: Sequence[StudyResults]) -> list[str]:
    """Returns one line per incomplete study: how much is missing, and the command that runs it."""
    lines = []
    for study, cells in studies:
        incomplete = [cell for cell in cells if cell.missing > 0]
        if incomplete:
            trials = sum(cell.missing for cell in incomplete)
            share = f"{len(incomplete)} of {counted(len(cells), 'cell')}"
            command = study.command
            lines.append(
                f"missing: {counted(trials, 'trial')} in {share} of {study.name}; {command}"
            )
    return lines


def _missing_certificates(stored: int, overrides: Sequence[str]) -> str:
    """Returns the line that says how many certificates are missing, and the command for them."""
    keys = ("seed", "workers", "verify_dir")
    chosen = [word for word in overrides if key_of(word) in keys]
    command = shlex.join(["mppi-belief", "verify", *chosen])
    missing = len(CERTIFICATE_NAMES) - stored
    return f"missing: {missing} of {len(CERTIFICATE_NAMES)} certificates; {command}"
