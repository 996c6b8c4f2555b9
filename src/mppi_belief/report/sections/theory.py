"""The certificates of the paper's statements: an overview, and a section for each."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from ...results.certificate import Certificate
from ...results.certificate_files import StoredCertificate
from ..certificate_tables import FAILS, HOLDS, certificate_frame, certificate_numbers
from ..elements import write_page_table, write_picture
from ..figures.certificate_panels import certificate_figure
from ..frame_files import write_frame
from ..origin import full_commit
from ..page import PageTable, Section


def theory_sections(stored: Sequence[StoredCertificate], folder: Path) -> list[Section]:
    """Builds the overview and a section per certificate; returns none without certificates."""
    if not stored:
        return []
    certificates = [stored_certificate.certificate for stored_certificate in stored]
    counts = [sum(check.holds for check in certificate.checks) for certificate in certificates]
    overview = pd.DataFrame(
        {
            "Statement": [certificate.statement for certificate in certificates],
            "Checks": [str(len(certificate.checks)) for certificate in certificates],
            "Hold": [str(count) for count in counts],
            "Verdict": [HOLDS if certificate.holds else FAILS for certificate in certificates],
        }
    )
    write_frame(folder, "theory", overview, certificate_numbers(certificates))
    text = (
        "Each statement of the paper is tested by numbers that must lie in a band. The bands are "
        "derived from rounding, from the order of a scheme, from a standard error or from a bound. "
        "`mppi-belief verify` computes the certificates."
    )
    first = Section("Theory", [text], [PageTable("theory", "Certificates", overview)])
    return [first, *(_certificate_section(certificate, folder) for certificate in certificates)]


def _certificate_section(certificate: Certificate, folder: Path) -> Section:
    """Builds the section of one certificate; the verdicts that fail are in bold."""
    stem = f"theory_{certificate.name}"
    frame = certificate_frame([certificate], FAILS).drop(columns="Statement")
    column = list(frame.columns).index("Verdict")
    failing = [(row, column) for row, check in enumerate(certificate.checks) if not check.holds]
    table = write_page_table(folder, stem, "Checks", frame)._replace(bold=failing)
    alt = "; ".join(panel.title for panel in certificate.panels)
    pictures = write_picture(folder, stem, lambda: certificate_figure(certificate.panels), alt)
    return Section(certificate.statement, [certificate.text], [table], pictures)


def theory_provenance(stored: Sequence[StoredCertificate]) -> list[tuple[str, str]]:
    """Returns commit and seed of the certificates, for the end of the page."""
    origins = {
        f"{full_commit(certificate.source)}, seed {certificate.source.get('seed')}"
        for certificate in stored
    }
    return [("certificates", "; ".join(sorted(origins)))] if origins else []


def theory_warnings(stored: Sequence[StoredCertificate]) -> list[str]:
    """Returns one line per reason not to trust the certificates."""
    lines = [
        f"{certificate.certificate.statement} does not hold."
        for certificate in stored
        if not certificate.certificate.holds
    ]
    if any(certificate.source.get("dirty") for certificate in stored):
        lines.append("Some certificates were computed from a checkout with uncommitted changes.")
    if len({full_commit(certificate.source) for certificate in stored}) > 1:
        lines.append("The certificates come from different commits.")
    return lines
