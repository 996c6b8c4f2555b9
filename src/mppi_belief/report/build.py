"""Builds the report of studies: tables and figures as files, and one page with all of them."""

import shlex
from collections.abc import Callable, Sequence
from pathlib import Path

from ..config.cell import Cell
from ..config.request import key_of
from ..errors import counted
from ..results.certificate import CERTIFICATE_NAMES
from ..results.certificate_files import StoredCertificate, load_certificates
from .cell_results import CellResults, Studies, read_cell_results
from .frame_files import write_text_file
from .origin import trial_provenance, trial_warnings
from .page import Page, render
from .sections import PAPER_STUDIES, study_sections
from .sections.table_1 import table_1_frame
from .sections.theory import theory_provenance, theory_sections, theory_warnings

INDEX_HTML = "index.html"
STUDIES = tuple(PAPER_STUDIES)  # of a report that is not asked for others
TITLE = "Path integral control in Gaussian belief space: the experiments reproduced"
LEAD = (
    "Das and Tanaka plan in the space of Gaussian beliefs and report a vehicle that never "
    "collides, while three baselines do. This page shows their experiments, repeated with this "
    "package, beside the numbers of the paper."
)


def report_studies(
    studies: dict[str, list[Cell]], verify_dir: Path | None, folder: Path, overrides: Sequence[str]
) -> bool:
    """Writes the report of some studies into `folder`; returns whether it is complete.

    Reads the results of the studies' cells and, unless `verify_dir` is None, the certificates.
    Prints Table I, warnings, and for whatever is missing the command that runs it; `overrides` are
    the settings of this command line.
    """
    warnings: dict[str, None] = {}  # cells that two studies share warn once
    results = {name: _read_study(cells, warnings.setdefault) for name, cells in studies.items()}
    certificates = [] if verify_dir is None else load_certificates(verify_dir)
    page = write_report(results, certificates, folder, list(warnings))

    table_1 = results.get("table_1", [])
    if any(len(cell.good) for cell in table_1):
        print(table_1_frame(table_1).to_string(index=False))
    missing = missing_lines(results, overrides)
    if verify_dir is not None and len(certificates) < len(CERTIFICATE_NAMES):
        missing.append(_missing_certificates(len(certificates), overrides))
    for line in [*warnings, *theory_warnings(certificates), *missing]:
        print(line)
    print(f"report: {page}")
    return not missing


def _read_study(cells: Sequence[Cell], warn: Callable[[str], object]) -> list[CellResults]:
    """Reads the results of each distinct cell of a study."""
    distinct = {cell.id: cell for cell in cells}.values()
    return [
        read_cell_results(cell, Path(cell.config["results_dir"]), cell.config["n_trials"], warn)
        for cell in distinct
    ]


def write_report(
    studies: Studies,
    certificates: Sequence[StoredCertificate],
    folder: Path,
    warnings: Sequence[str],
) -> Path:
    """Writes the page and its tables and figures into `folder`; returns the path of the page.

    `warnings` are shown on the page, after those about the trials and the certificates.
    """
    folder.mkdir(parents=True, exist_ok=True)
    distinct: dict[str, CellResults] = {}
    for cells in studies.values():
        distinct |= {cell.id: cell for cell in cells}
    cells = list(distinct.values())

    page = Page(
        title=TITLE,
        lead=LEAD,
        warnings=[*trial_warnings(cells), *theory_warnings(certificates), *warnings],
        sections=[*study_sections(studies, folder), *theory_sections(certificates, folder)],
        provenance=[*trial_provenance(cells), *theory_provenance(certificates)],
    )
    write_text_file(folder / INDEX_HTML, render(page, folder))
    return folder / INDEX_HTML


def missing_lines(studies: Studies, overrides: Sequence[str]) -> list[str]:
    """Returns one line per incomplete study: how much is missing, and the command that runs it."""
    lines = []
    for name, cells in studies.items():
        incomplete = [cell for cell in cells if cell.missing > 0]
        if incomplete:
            trials = sum(cell.missing for cell in incomplete)
            command = shlex.join(["mppi-belief", "run", f"experiment={name}", *overrides])
            share = f"{len(incomplete)} of {counted(len(cells), 'cell')}"
            lines.append(f"missing: {counted(trials, 'trial')} in {share} of {name}; {command}")
    return lines


def _missing_certificates(stored: int, overrides: Sequence[str]) -> str:
    """Returns the line that says how many certificates are missing, and the command for them."""
    keys = ("seed", "workers", "verify_dir")
    chosen = [word for word in overrides if key_of(word) in keys]
    command = shlex.join(["mppi-belief", "verify", *chosen])
    missing = len(CERTIFICATE_NAMES) - stored
    return f"missing: {missing} of {len(CERTIFICATE_NAMES)} certificates; {command}"
