"""The report as one HTML file that needs nothing else: tables and figures, each with what it shows."""

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


class Table(NamedTuple):
    """Cells of text under a caption; `stem` names the files beside the page that hold it (csv, md, tex).

    The first column heads the rows; the frame's index is not shown. `bold` are the cells that stand out,
    by position: (row, column), from 0.
    """

    stem: str
    caption: str
    frame: pd.DataFrame
    bold: Collection[tuple[int, int]] = ()


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


MEDIA = {".png": "image/png", ".gif": "image/gif"}
PNG_SCALE = 1.4  # pixels of a PNG per pixel of the page: text of 7.5 points at 200 to the inch is as large as a table's
PROSE = 28  # a text longer than this may break into lines
BLANK = {"", "-", "\u2013", "\u2014", "n/a"}
NUMBER = re.compile(
    r"[<>≤≥≈~]?\s*[-+\u2212±]?(\d[\d,]*\.?\d*|\.\d+|inf|nan)(e[-+\u2212]?\d+)?(?!\w)", re.IGNORECASE
)


def render(page: Page, folder: Path) -> str:
    """The page as HTML, the pictures of `folder` within it; the same page and files give the same text.

    All text is plain and escaped; in prose and captions, not in titles and cells, `code` stands in backticks.
    A picture that is not in the folder becomes a note. The links to files beside the page are relative to the
    folder, and are there for the files that exist. ValueError: a picture is neither PNG nor GIF.
    """
    environment = Environment(
        loader=PackageLoader("mppi_belief.report", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(code=_code, plain=_plain)
    return environment.get_template("page.html.jinja").render(
        page=page,
        anchors=_anchors(section.title for section in page.sections),
        columns=_columns,
        embed=partial(_embed, folder),
        picture_files=partial(_picture_files, folder),
        table_files=partial(_table_files, folder),
    )


def _code(text: str) -> Markup:
    """Escaped, with `code` in backticks as an element."""
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def _plain(text: str) -> str:
    """Without the backticks of `_code`, for attributes."""
    return re.sub("`([^`]+)`", r"\1", text)


def _anchors(titles: Iterable[str]) -> list[str]:
    """An id for every title, made of its ASCII letters and digits."""
    anchors = ["provenance", "warnings"]
    for title in titles:
        ascii_title = (
            unicodedata.normalize("NFKD", title).encode("ascii", "ignore").decode().lower()
        )
        stem = anchor = re.sub("[^a-z0-9]+", "-", ascii_title).strip("-") or "section"
        count = 1
        while anchor in anchors:
            count += 1
            anchor = f"{stem}-{count}"
        anchors.append(anchor)
    return anchors[2:]


def _columns(frame: pd.DataFrame) -> list[tuple[str, str]]:
    """Name and kind of every column: "number" (to the right), "prose" (may break) or "word"."""
    cells = frame.astype(str).to_numpy()
    return [(str(name), _kind(cells[:, index])) for index, name in enumerate(frame.columns)]


def _kind(cells: Iterable[str]) -> str:
    filled = [cell for cell in cells if cell.strip() not in BLANK]
    if filled and all(NUMBER.match(cell.strip()) for cell in filled):
        return "number"
    return "prose" if any(len(cell) > PROSE for cell in filled) else "word"


class _Embedded(NamedTuple):
    """A picture as a data URI, and the size to show it at in px, 0 where it is its own."""

    uri: str
    width: int
    height: int


def _embed(folder: Path, picture: Picture) -> _Embedded | None:
    """The picture within the page, None where there is none."""
    path = folder / picture.file
    media = MEDIA.get(path.suffix.lower())
    if media is None:
        raise ValueError(f"a picture of the page must be a PNG or a GIF, not {picture.file!r}")
    if not path.is_file():
        return None
    data = path.read_bytes()
    header = data[16:24] if media == "image/png" else b""  # width and height, big-endian
    width, height = (round(int.from_bytes(part) / PNG_SCALE) for part in (header[:4], header[4:]))
    return _Embedded(f"data:{media};base64,{base64.b64encode(data).decode()}", width, height)


def _picture_files(folder: Path, picture: Picture) -> list[tuple[str, str]]:
    return _files(
        folder, picture.file.removesuffix(PurePath(picture.file).suffix), ("png", "gif", "pdf")
    )


def _table_files(folder: Path, table: Table) -> list[tuple[str, str]]:
    return _files(folder, table.stem, ("csv", "md", "tex"))


def _files(folder: Path, stem: str, suffixes: Iterable[str]) -> list[tuple[str, str]]:
    """Name and relative address of those files that exist."""
    return [
        (suffix.upper(), quote(f"{stem}.{suffix}"))
        for suffix in suffixes
        if (folder / f"{stem}.{suffix}").is_file()
    ]
