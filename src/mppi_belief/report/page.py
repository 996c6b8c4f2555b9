"""Renders the report as one HTML file that holds all tables and figures and loads nothing else."""

import base64
import re
import unicodedata
from collections.abc import Collection, Iterable, Sequence
from functools import partial
from pathlib import Path, PurePath
from typing import NamedTuple
from urllib.parse import quote

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape


class PageTable(NamedTuple):
    """Holds a table of text. The first column heads the rows; the frame's index is not shown."""

    stem: str  # of the files beside the page that hold the table: STEM.csv, STEM.md, STEM.tex
    caption: str
    frame: pd.DataFrame
    bold: Collection[tuple[int, int]] = ()  # cells in bold by (row, column), counted from 0


class Picture(NamedTuple):
    """Holds a picture that lies beside the page."""

    file: str  # a PNG, with a PDF of the same stem beside it, or a GIF
    alt: str  # describes what the picture shows; also its caption


class Section(NamedTuple):
    """Holds one section of the page: what its tables and pictures show, in a few sentences."""

    title: str
    text: Sequence[str]  # paragraphs
    tables: Sequence[PageTable] = ()
    pictures: Sequence[Picture] = ()


class Page(NamedTuple):
    """Holds everything that the page shows."""

    title: str
    lead: str
    warnings: Sequence[str]
    sections: Sequence[Section]
    provenance: Sequence[tuple[str, str]]  # pairs of a name and a value


MEDIA = {".png": "image/png", ".gif": "image/gif"}
PNG_SCALE = 1.4  # PNG pixels per page pixel: 7.5 points at 200 dpi are as large as a table's text
PROSE_LENGTH = 28  # characters; a longer cell may break into lines
BLANK = {"", "-", "\u2013", "\u2014", "n/a"}
NUMBER = re.compile(
    r"[<>≤≥≈~]?\s*[-+\u2212±]?(\d[\d,]*\.?\d*|\.\d+|inf|nan)(e[-+\u2212]?\d+)?(?!\w)", re.IGNORECASE
)


def render(page: Page, folder: Path) -> str:
    """Returns the page as HTML with the pictures of `folder` embedded.

    The same page and files always give the same text. All text is plain and escaped. In prose and
    captions, but not in titles and cells, backticks mark `code`. A picture that is absent from the
    folder becomes a note. Links lead to those files beside the page that exist, relative to the
    folder.

    Raises ValueError for a picture that is neither PNG nor GIF.
    """
    environment = Environment(
        loader=PackageLoader("mppi_belief.report", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(code=_mark_code, plain=_without_backticks)
    return environment.get_template("page.html.jinja").render(
        page=page,
        anchors=_anchors(section.title for section in page.sections),
        columns=_column_kinds,
        embed=partial(_embed, folder),
        picture_files=partial(_picture_files, folder),
        table_files=partial(_table_files, folder),
    )


def _mark_code(text: str) -> Markup:
    """Escapes a text and turns what stands in backticks into `code` elements."""
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def _without_backticks(text: str) -> str:
    """Removes the backticks around code, for attributes."""
    return re.sub("`([^`]+)`", r"\1", text)


def _anchors(titles: Iterable[str]) -> list[str]:
    """Returns a distinct id per title, made of its ASCII letters and digits."""
    reserved = ["provenance", "warnings"]
    anchors = list(reserved)
    for title in titles:
        ascii_title = (
            unicodedata.normalize("NFKD", title).encode("ascii", "ignore").decode().lower()
        )
        stem = re.sub("[^a-z0-9]+", "-", ascii_title).strip("-") or "section"
        anchor = stem
        count = 1
        while anchor in anchors:
            count += 1
            anchor = f"{stem}-{count}"
        anchors.append(anchor)
    return anchors[len(reserved) :]


def _column_kinds(frame: pd.DataFrame) -> list[tuple[str, str]]:
    """Returns name and kind of each column: "number" (right-aligned), "prose" or "word"."""
    cells = frame.astype(str).to_numpy()
    return [(str(name), _kind(cells[:, index])) for index, name in enumerate(frame.columns)]


def _kind(cells: Iterable[str]) -> str:
    """Returns the kind of a column from the texts of its cells."""
    filled = [cell for cell in cells if cell.strip() not in BLANK]
    if filled and all(NUMBER.match(cell.strip()) for cell in filled):
        return "number"
    return "prose" if any(len(cell) > PROSE_LENGTH for cell in filled) else "word"


class _Embedded(NamedTuple):
    """Holds a picture as a data URI."""

    uri: str
    width: int  # px at which it is shown, 0 for its own size
    height: int  # px, likewise


def _embed(folder: Path, picture: Picture) -> _Embedded | None:
    """Reads a picture; returns None where there is no such file."""
    path = folder / picture.file
    media = MEDIA.get(path.suffix.lower())
    if media is None:
        raise ValueError(f"a picture of the page must be a PNG or a GIF, not {picture.file!r}")
    if not path.is_file():
        return None
    data = path.read_bytes()
    header = data[16:24] if media == "image/png" else b""  # width and height, big-endian
    width = round(int.from_bytes(header[:4]) / PNG_SCALE)
    height = round(int.from_bytes(header[4:]) / PNG_SCALE)
    return _Embedded(f"data:{media};base64,{base64.b64encode(data).decode()}", width, height)


def _picture_files(folder: Path, picture: Picture) -> list[tuple[str, str]]:
    """Returns the links to the files of a picture."""
    stem = picture.file.removesuffix(PurePath(picture.file).suffix)
    return _existing_files(folder, stem, ("png", "gif", "pdf"))


def _table_files(folder: Path, table: PageTable) -> list[tuple[str, str]]:
    """Returns the links to the files of a table."""
    return _existing_files(folder, table.stem, ("csv", "md", "tex"))


def _existing_files(folder: Path, stem: str, suffixes: Iterable[str]) -> list[tuple[str, str]]:
    """Returns name and relative address of those files that exist."""
    return [
        (suffix.upper(), quote(f"{stem}.{suffix}"))
        for suffix in suffixes
        if (folder / f"{stem}.{suffix}").is_file()
    ]
