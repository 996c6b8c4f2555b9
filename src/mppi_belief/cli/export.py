"""Exports the rows of many cells as one CSV, each with its cell and commit, in full precision."""

import csv
import io
import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import pandas as pd

from ..config.cell import labels
from ..results.columns import COLUMNS
from ..results.contents import CellContents
from ..results.sources import source_finder
from .tables import commit_label

NULLABLE_COLUMNS = ("status", "controller", "collided", "error")  # pandas has NaN for None there


def as_csv(cells: Sequence[CellContents]) -> tuple[str, int]:
    """Returns the CSV as text, and its number of rows.

    The columns are cell, commit, those that all rows have, then the settings that were swept. A
    float is written as the shortest text that reads back as the same float (also nan, inf and
    -inf); None is an empty field.
    """
    lines = list(itertools.chain.from_iterable(_csv_lines(contents) for contents in cells))
    names = dict.fromkeys(["cell", "commit", *COLUMNS])
    for line in lines:
        names |= dict.fromkeys(line)
    text = io.StringIO()
    writer = csv.DictWriter(text, list(names), restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return text.getvalue(), len(lines)


def _csv_lines(contents: CellContents) -> Iterator[dict[str, str]]:
    """Yields one line per row of a cell."""
    find_source = source_finder(contents)
    for values in contents.rows.to_dict("records"):
        source = find_source(values["trial"], values["_file"])
        line = {"cell": contents.folder.name, "commit": commit_label(source, short=False)}
        for name in COLUMNS:
            is_none = name in NULLABLE_COLUMNS and pd.isna(values[name])
            line[name] = "" if is_none else _exact_text(values[name])
        for name, value in _swept_settings(source).items():
            line.setdefault(name, _exact_text(value))
        yield line


def _swept_settings(source: dict[str, Any]) -> dict[str, Any]:
    """Returns the labels of the configuration that made a row; none where it is not stored."""
    try:
        return labels(source["config"])
    except (KeyError, TypeError, AttributeError):
        return {}


def _exact_text(value: Any) -> str:
    """Returns a text that reads back as the same value; the empty text for None."""
    if value is None:
        return ""
    return repr(value) if isinstance(value, float) else str(value)
