"""The report: every table and figure of the studies, and one page with all of them."""

import shlex
from collections.abc import Callable, Sequence
from pathlib import Path

from ..config.cell import Cell
from ..results.certificate import CERTIFICATE_NAMES
from ..results.certificate_files import StoredCertificate, load_certificates
from .cell_results import CellResults, read_cell_results
from .comparison import table_1
from .frame_files import write_text_file
from .origin import trial_provenance, trial_warnings
from .page import Page, render
from .sections import theory
from .sections.studies import BUILDERS, Studies, sections

PAGE = "index.html"
STUDIES = tuple(BUILDERS)
TITLE = "Path integral control in Gaussian belief space: the experiments, run anew"
LEAD = (
    "Das and Tanaka plan in the space of Gaussian beliefs and report a vehicle that never collides where three "
    "baselines do. These are their experiments with this package, beside the numbers they print."
)


def report_studies(
    studies: dict[str, list[Cell]], verify_dir: Path | None, folder: Path, overrides: Sequence[str]
) -> bool:
    """Read the results of some studies' cells and, from `verify_dir`, the certificates, write the report into `folder`
    and say on the terminal what it holds and what is missing; whether everything was there."""
    complaints: dict[str, None] = {}  # cells that two studies share complain once
    found = {
        name: [
            _find(cell, complaints.setdefault)
            for cell in {cell.id: cell for cell in cells}.values()
        ]
        for name, cells in studies.items()
    }
    certificates = [] if verify_dir is None else load_certificates(verify_dir)
    page = write_report(found, certificates, folder, list(complaints))
    if any(len(one.good) for one in found.get("table_1", [])):
        print(table_1(found["table_1"]).to_string(index=False))
    lines = missing_lines(found, overrides)
    if verify_dir is not None and len(certificates) < len(CERTIFICATE_NAMES):
        chosen = [
            word
            for word in overrides
            if word.partition("=")[0] in ("seed", "workers", "verify_dir")
        ]
        command = shlex.join(["mppi-belief", "verify", *chosen])
        lines.append(
            f"missing: {len(CERTIFICATE_NAMES) - len(certificates)} of {len(CERTIFICATE_NAMES)} certificates; {command}"
        )
    for line in [*complaints, *theory.warnings(certificates), *lines]:
        print(line)
    print(f"report: {page}")
    return not lines


def _find(cell: Cell, warn: Callable[[str], object]) -> CellResults:
    return read_cell_results(cell, Path(cell.config["results_dir"]), cell.config["n_trials"], warn)


def write_report(
    studies: Studies,
    certificates: Sequence[StoredCertificate],
    folder: Path,
    complaints: Sequence[str],
) -> Path:
    """Write everything into `folder` and return the page's path; `complaints` are shown as warnings."""
    folder.mkdir(parents=True, exist_ok=True)
    founds: list[CellResults] = list(
        {one.cell.id: one for founds in studies.values() for one in founds}.values()
    )
    shown = [*sections(studies, folder), *theory.sections(certificates, folder)]
    warned = [*trial_warnings(founds), *theory.warnings(certificates), *complaints]
    page = Page(
        TITLE, LEAD, warned, shown, [*trial_provenance(founds), *theory.provenance(certificates)]
    )
    write_text_file(folder / PAGE, render(page, folder))
    return folder / PAGE


def missing_lines(studies: Studies, overrides: Sequence[str]) -> list[str]:
    """One line for each study that is not complete: what is missing, and the command that runs it."""
    lines = []
    for name, founds in studies.items():
        behind = [found for found in founds if found.missing > 0]
        if behind:
            trials = sum(found.missing for found in behind)
            command = shlex.join(["mppi-belief", "run", f"experiment={name}", *overrides])
            lines.append(
                f"missing: {trials} trials in {len(behind)} of {len(founds)} cells of {name}; {command}"
            )
    return lines
