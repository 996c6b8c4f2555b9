"""Prints certificates of the paper's statements and writes them as tables and figures."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import pandas as pd

from ..results.certificate import Certificate, Check
from ..results.certificate_files import StoredCertificate
from .elements import write_picture
from .figures.certificate_panels import certificate_figure
from .frame_files import write_frame

HOLDS = "holds"
FAILS = "FAILS"  # the verdict on a statement of the paper
DOES_NOT_HOLD = "does not hold"  # the verdict on a user's own system, which need not meet it


def show_certificates(
    chosen: Sequence[StoredCertificate], stored: Sequence[StoredCertificate], folder: Path
) -> bool:
    """Prints the chosen certificates and draws their figures; returns whether all of them hold.

    Also writes a table of all `stored` certificates as certificates.md and certificates.csv.
    """
    for stored_certificate in chosen:
        certificate = stored_certificate.certificate
        _print_certificate(certificate, f"{stored_certificate.seconds:.1f} s", FAILS)
        draw = partial(certificate_figure, certificate.panels)
        write_picture(folder, certificate.name, draw, "")

    certificates = [stored_certificate.certificate for stored_certificate in stored]
    text = certificate_frame(certificates, FAILS)
    write_frame(folder, "certificates", text, certificate_numbers(certificates))

    holding = sum(stored_certificate.certificate.holds for stored_certificate in chosen)
    checks = sum(len(stored_certificate.certificate.checks) for stored_certificate in chosen)
    table = folder / "certificates.md"
    print(f"{holding} of {len(chosen)} certificates hold, with {checks} checks; table: {table}")
    return holding == len(chosen)


def show_system_certificate(certificate: Certificate, folder: Path) -> None:
    """Prints what holds for one system and writes it as a table into `folder`."""
    _print_certificate(certificate, "", DOES_NOT_HOLD)
    print(certificate.text)
    text = certificate_frame([certificate], DOES_NOT_HOLD)
    write_frame(folder, certificate.name, text, certificate_numbers([certificate]))
    print(f"table: {folder / certificate.name}.md")


def _print_certificate(certificate: Certificate, remark: str, negative: str) -> None:
    """Prints a certificate as lines of aligned columns."""
    rows = [
        (check.computed, _value_text(check), check.band, _verdict_text(check, negative))
        for check in certificate.checks
    ]
    widths = [max(len(row[column]) for row in rows) for column in range(3)]
    print(f"{certificate.statement}{f'  ({remark})' if remark else ''}")
    for computed, value, band, verdict in rows:
        print(f"  {computed:<{widths[0]}}  {value:>{widths[1]}}  {band:<{widths[2]}}  {verdict}")
    print()


def _value_text(check: Check) -> str:
    return f"{check.value:.4g}"


def _verdict_text(check: Check, negative: str) -> str:
    return HOLDS if check.holds else negative


def certificate_frame(certificates: Sequence[Certificate], negative: str) -> pd.DataFrame:
    """Returns a line of text per check; `negative` is the verdict on a check that fails."""
    lines = []
    for certificate in certificates:
        for check in certificate.checks:
            line = {
                "Statement": certificate.statement,
                "Computed": check.computed,
                "Value": _value_text(check),
                "Band": check.band,
                "Verdict": _verdict_text(check, negative),
                "Where the band comes from": check.derived,
            }
            lines.append(line)
    return pd.DataFrame(lines)


def certificate_numbers(certificates: Sequence[Certificate]) -> pd.DataFrame:
    """Returns a line per check in full precision."""
    lines = []
    for certificate in certificates:
        for check in certificate.checks:
            line = {"certificate": certificate.name, "statement": certificate.statement}
            lines.append({**line, **check._asdict(), "holds": check.holds})
    return pd.DataFrame(lines)
