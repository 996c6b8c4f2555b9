"""Rows of many cells as one CSV, each with its cell and its commit; numbers read back bit for bit."""

import csv
import io
from collections.abc import Iterator, Sequence
from typing import Any

import pandas as pd

from ..config.cell import labels
from ..results.columns import COLUMNS
from ..results.contents import CellContents
from ..results.sources import source_finder
from .tables import short_commit

_TEXT = ("status", "controller", "collided", "error")  # columns in which pandas has NaN for nothing


def as_csv(cells: Sequence[CellContents]) -> tuple[str, int]:
    """The table as text and the number of its rows: cell, commit, what all rows have, then what was swept.

    A float is its shortest text that is that very float (nan, inf and -inf too), nothing is an empty field.
    """
    lines = [line for contents in cells for line in _lines(contents)]
    names = dict.fromkeys(["cell", "commit", *COLUMNS]) | dict.fromkeys(
        name for line in lines for name in line
    )
    text = io.StringIO()
    writer = csv.DictWriter(text, list(names), restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return text.getvalue(), len(lines)


def _lines(contents: CellContents) -> Iterator[dict[str, str]]:
    rows, find = contents.rows, source_finder(contents)
    for values in rows.to_dict("records"):
        source = find(values["trial"], values["_file"])
        swept = {name: value for name, value in _swept(source).items() if name not in COLUMNS}
        row = {
            name: None if name in _TEXT and pd.isna(values[name]) else values[name]
            for name in COLUMNS
        }
        yield {"cell": contents.folder.name, "commit": short_commit(source, short=False)} | {
            name: _exact(value) for name, value in (row | swept).items()
        }


def _swept(source: dict[str, Any]) -> dict[str, Any]:
    try:
        return labels(source["config"])
    except (KeyError, TypeError, AttributeError):
        return {}


def _exact(value: Any) -> str:
    if value is None:
        return ""
    return repr(value) if isinstance(value, float) else str(value)
