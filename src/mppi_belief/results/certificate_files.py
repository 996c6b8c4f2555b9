"""Certificates on disk: <verify_dir>/<name>.json, each with where it comes from, written whole or not at all."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from .certificate import NAMES, Certificate, as_dict, from_dict
from .files import read_json, write_json


class Stored(NamedTuple):
    """A certificate, the seconds it took, and where it comes from: commit, versions, machine, seed."""

    certificate: Certificate
    seconds: float
    source: dict[str, Any]


def store(folder: Path, one: Stored) -> None:
    """Write a certificate; raises OSError."""
    content = {
        "certificate": as_dict(one.certificate),
        "seconds": one.seconds,
        "source": one.source,
    }
    write_json(folder, one.certificate.name, content)


def load(folder: Path, names: Sequence[str] = NAMES) -> list[Stored]:
    """The certificates of `names` that are there and can be read, in that order."""
    found = []
    for name in names:
        content = read_json(folder, name) or {}
        try:
            one = Stored(
                from_dict(content["certificate"]),
                float(content["seconds"]),
                dict(content["source"]),
            )
        except (KeyError, TypeError, ValueError):
            continue  # not there, or not a certificate: it counts as missing
        if one.certificate.name == name:
            found.append(one)
    return found
