"""Certificates of the paper's statements: on the terminal, as files, and as sections of the page."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from ...results.certificate import Certificate, Check
from ...results.certificate_files import StoredCertificate
from .. import figures
from ..elements import write_picture, write_table
from ..frame_files import write_frame
from ..origin import full_commit
from ..page import Section, Table

HOLDS, FAILS, DOES_NOT = "holds", "FAILS", "does not hold"


def show_certificates(
    chosen: Sequence[StoredCertificate], stored: Sequence[StoredCertificate], folder: Path
) -> bool:
    """Print the chosen certificates and draw their figures into `folder`, with a table of all that are stored there;
    whether the chosen ones hold."""
    for one in chosen:
        _print(one.certificate, f"{one.seconds:.1f} s", FAILS)
        write_picture(
            folder, one.certificate.name, figures.certificate_figure(one.certificate.panels), ""
        )
    everything = [one.certificate for one in stored]
    write_frame(folder, "certificates", _checks(everything, FAILS), _numbers(everything))
    certificates = [one.certificate for one in chosen]
    held = [one for one in certificates if one.holds]
    checks = sum(len(one.checks) for one in certificates)
    print(
        f"{len(held)} of {len(certificates)} certificates hold, {checks} checks; {folder / 'certificates.md'}"
    )
    return len(held) == len(certificates)


def show_system(found: Certificate, folder: Path) -> None:
    """Print what holds for one system and write it into `folder`."""
    _print(found, "", DOES_NOT)
    print(found.text)
    write_frame(folder, found.name, _checks([found], DOES_NOT), _numbers([found]))
    print(f"written: {folder / found.name}.md")


def _print(one: Certificate, aside: str, fails: str) -> None:
    """A certificate as lines of aligned columns."""
    rows = [
        (check.computed, _value(check), check.band, _verdict(check, fails)) for check in one.checks
    ]
    widths = [max(len(row[column]) for row in rows) for column in range(3)]
    print(f"{one.statement}{f'  ({aside})' if aside else ''}")
    for computed, value, band, verdict in rows:
        print(f"  {computed:<{widths[0]}}  {value:>{widths[1]}}  {band:<{widths[2]}}  {verdict}")
    print()


def _value(check: Check) -> str:
    return f"{check.value:.4g}"


def _verdict(check: Check, fails: str) -> str:
    return HOLDS if check.holds else fails


def _checks(certificates: Sequence[Certificate], fails: str) -> pd.DataFrame:
    """Every check as text."""
    return pd.DataFrame(
        [
            {
                "Statement": one.statement,
                "Computed": check.computed,
                "Value": _value(check),
                "Band": check.band,
                "Verdict": _verdict(check, fails),
                "Where the band comes from": check.derived,
            }
            for one in certificates
            for check in one.checks
        ]
    )


def _numbers(certificates: Sequence[Certificate]) -> pd.DataFrame:
    """Every check in full precision."""
    return pd.DataFrame(
        [
            {
                "certificate": one.name,
                "statement": one.statement,
                **check._asdict(),
                "holds": check.holds,
            }
            for one in certificates
            for check in one.checks
        ]
    )


def provenance(stored: Sequence[StoredCertificate]) -> list[tuple[str, str]]:
    """Where the certificates come from, for the end of the page."""
    origins = sorted(
        {f"{full_commit(one.source)}, seed {one.source.get('seed')}" for one in stored}
    )
    return [("certificates", "; ".join(origins))] if origins else []


def warnings(stored: Sequence[StoredCertificate]) -> list[str]:
    """What should keep a reader from trusting the certificates; one line each."""
    lines = [
        f"{one.certificate.statement} does not hold." for one in stored if not one.certificate.holds
    ]
    if any(one.source.get("dirty") for one in stored):
        lines.append("Some certificates were computed from a checkout with uncommitted changes.")
    if len({full_commit(one.source) for one in stored}) > 1:
        lines.append("The certificates come from different commits.")
    return lines


def sections(stored: Sequence[StoredCertificate], folder: Path) -> list[Section]:
    """The theory part of the page: an overview, and a section for every certificate that has figures."""
    if not stored:
        return []
    certificates = [one.certificate for one in stored]
    overview = pd.DataFrame(
        {
            "Statement": [one.statement for one in certificates],
            "Checks": [str(len(one.checks)) for one in certificates],
            "Hold": [str(sum(check.holds for check in one.checks)) for one in certificates],
            "Verdict": [HOLDS if one.holds else FAILS for one in certificates],
        }
    )
    write_frame(folder, "theory", overview, _numbers(certificates))
    said = (
        "Every statement of the paper as numbers with the bands they must lie in, derived from rounding, from the "
        "order of a scheme, from a standard error or from a bound. Computed by `mppi-belief verify`."
    )
    first = Section("Theory", [said], [Table("theory", "Certificates", overview)])
    return [first, *(_section(one, folder) for one in certificates)]


def _section(one: Certificate, folder: Path) -> Section:
    frame = _checks([one], FAILS).drop(columns="Statement")
    verdict = list(frame.columns).index("Verdict")
    bold = [(row, verdict) for row, check in enumerate(one.checks) if not check.holds]
    made = write_table(folder, f"theory_{one.name}", "Checks", frame)._replace(bold=bold)
    alt = "; ".join(panel.title for panel in one.panels)
    drawn = write_picture(folder, f"theory_{one.name}", figures.certificate_figure(one.panels), alt)
    return Section(one.statement, [one.text], [made], drawn)
