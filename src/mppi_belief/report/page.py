"""The report as one HTML file that needs nothing else: tables and figures, each with what it shows."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd


class Table(NamedTuple):
    """Cells of text under a caption; `stem` names the files beside the page that hold it (csv, md, tex)."""

    stem: str
    caption: str
    frame: pd.DataFrame


class Picture(NamedTuple):
    """A picture beside the page, `file` a PNG (a PDF of the same stem beside it) or a GIF; `alt` says what is seen."""

    file: str
    alt: str


class Section(NamedTuple):
    """One question: a sentence or two on what its tables and pictures show."""

    title: str
    text: Sequence[str]  # paragraphs
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()


class Page(NamedTuple):
    """The whole report."""

    title: str
    lead: str
    warnings: Sequence[str]
    sections: Sequence[Section]
    provenance: Sequence[tuple[str, str]]  # what, value


def render(page: Page, folder: Path) -> str:
    """The page as HTML, the pictures of `folder` within it."""
    raise NotImplementedError
