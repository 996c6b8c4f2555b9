"""Certificates on disk: <verify_dir>/<name>.json, each written atomically with its origin."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from .certificate import CERTIFICATE_NAMES, Certificate, as_dict, from_dict
from .files import read_json, write_json


class StoredCertificate(NamedTuple):
    """Holds a certificate, how long it took, and its origin."""

    certificate: Certificate
    seconds: float  # computing time
    source: dict[str, Any]  # commit, versions, machine, command, seed


def store_certificate(folder: Path, stored: StoredCertificate) -> None:
    """Writes `folder`/<name>.json; raises OSError if that is impossible."""
    content = {
        "certificate": as_dict(stored.certificate),
        "seconds": stored.seconds,
        "source": stored.source,
    }
    write_json(folder, stored.certificate.name, content)


def load_certificates(
    folder: Path, names: Sequence[str] = CERTIFICATE_NAMES
) -> list[StoredCertificate]:
    """Returns the certificates of `names` that exist and can be read, in that order."""
    loaded = []
    for name in names:
        content = read_json(folder, name) or {}
        try:
            stored = StoredCertificate(
                certificate=from_dict(content["certificate"]),
                seconds=float(content["seconds"]),
                source=dict(content["source"]),
            )
        except (KeyError, TypeError, ValueError):
            continue  # a file that is missing or holds no certificate counts as missing
        if stored.certificate.name == name:
            loaded.append(stored)
    return loaded
