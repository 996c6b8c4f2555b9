"""Fills docs/results.md from a results folder: tables, sentences with numbers, pictures.

    python docs/scripts/results_page.py [KEY=VALUE ...]            # settings as of `report`
    python docs/scripts/results_page.py --check [KEY=VALUE ...]    # exits with 1 if it differs

A block of the page stands between `<!-- report: NAME -->` and `<!-- end -->`. NAME is that of a
table of the report (`table_1`), which the block repeats, or of a function in results_blocks.py.
Nothing is run: `make results-page` runs what is missing first.
"""

import re
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from mppi_belief.cli.reported_studies import compose_studies, study_requests
from mppi_belief.config.request import Request
from mppi_belief.report import build
from mppi_belief.report.frame_files import as_markdown
from mppi_belief.report.page import PageTable
from mppi_belief.report.sections import study_sections
from mppi_belief.report.summary import BUSY_NOTE
from results_blocks import SENTENCES, PageSources

PAGE = Path(__file__).resolve().parents[1] / "results.md"
PICTURES = PAGE.parent / "img"
PROBLEMS = ("platt_2010", "van_den_berg_2012")  # studies beyond the paper that the page shows
BLOCK = re.compile(r"<!-- report: (?P<name>\w+) -->\n.*?<!-- end -->", re.DOTALL)
PICTURE = re.compile(r"!\[[^]]*\]\(img/(?P<file>[^)]+)\)")


def block_names(page: str) -> list[str]:
    """Returns the names of the blocks of a page, in order."""
    return [match["name"] for match in BLOCK.finditer(page)]


def without_blocks(page: str) -> str:
    """Returns what is written by hand on a page."""
    return BLOCK.sub("", page)


def filled(page: str, contents: dict[str, str]) -> str:
    """Returns the page with these contents of its blocks, in Markdown.

    Raises SystemExit that names the blocks without a content.
    """
    absent = [name for name in block_names(page) if name not in contents]
    if absent:
        raise SystemExit(f"no results for these blocks of {PAGE.name}: {', '.join(absent)}")
    return BLOCK.sub(
        lambda match: (
            f"<!-- report: {match['name']} -->\n\n{contents[match['name']].strip()}\n\n<!-- end -->"
        ),
        page,
    )


def page_sources(overrides: Sequence[str], folder: Path) -> PageSources:
    """Reads the results of the page's studies; writes the files of their sections to `folder`."""
    request = Request(overrides=tuple(overrides))
    names = (*build.STUDIES, *build.SUPPLEMENTARY, *PROBLEMS)
    composed = compose_studies(study_requests(names, request), request)
    studies = {
        study.name: build.read_study(study, composed.table_1, print).cells
        for study in composed.studies
    }
    with_results = {
        name: cells for name, cells in studies.items() if any(len(cell.good) for cell in cells)
    }
    return PageSources(with_results, study_sections(with_results, folder))


def block_contents(sources: PageSources) -> dict[str, str]:
    """Returns the content of every block that has results, in Markdown."""
    contents = {}
    for section in sources.sections:
        contents |= {table.stem: table_content(table) for table in section.tables}
    for name, (studies, sentence_of) in SENTENCES.items():
        if all(study in sources.studies for study in studies):
            contents[name] = sentence_of(sources)
    return {name: content for name, content in contents.items() if content}


def table_content(table: PageTable) -> str:
    """Returns a table in Markdown, with the note on times where some are marked."""
    note = f"\n{BUSY_NOTE}.\n" if BUSY_NOTE in table.caption else ""
    return f"{as_markdown(table.frame)}{note}"


def main(words: Sequence[str]) -> int:
    """Writes or checks the page and its pictures; returns the exit code."""
    check = "--check" in words
    page = PAGE.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sources = page_sources([word for word in words if word != "--check"], folder)
        new_page = filled(page, block_contents(sources))
        drawn = [file for file in PICTURE.findall(page) if (folder / file).is_file()]
        changed = [file for file in drawn if not _same_file(folder / file, PICTURES / file)]
        if not check:
            PAGE.write_text(new_page, encoding="utf-8")
            for file in changed:
                shutil.copyfile(folder / file, PICTURES / file)
    changed = [PAGE.name] * (new_page != page) + changed
    verb = "differs from the results" if check else "written"
    for file in changed:
        print(f"{file}: {verb}")
    return 1 if check and changed else 0


def _same_file(first: Path, second: Path) -> bool:
    """Returns whether two files have the same bytes."""
    return second.is_file() and first.read_bytes() == second.read_bytes()


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
