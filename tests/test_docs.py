"""The documents are true: links lead somewhere, Python runs, commands are accepted."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

import commands_page
import study_helpers
from cli_helpers import collect
from documents import DOCUMENTS, ROOT, code_blocks
from experiment_helpers import compiled_quickly
from mppi_belief.results import table
from mppi_belief.results.certificate import CERTIFICATE_NAMES

README_LINES = 100


def name_of(value: object) -> str:
    """Returns the name of a test's document."""
    return str(value.relative_to(ROOT)) if isinstance(value, Path) else str(value)


@pytest.fixture(autouse=True, scope="module")
def quick() -> Iterator[None]:
    """Compiles the documents' programs in little time."""
    with compiled_quickly():
        yield


@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_relative_links_lead_somewhere(document):
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", document.read_text()):
        if not target.startswith(("http:", "https:", "mailto:")):
            assert (document.parent / target).exists(), target


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= README_LINES


@pytest.mark.parametrize(
    "document",
    [page for page in DOCUMENTS if code_blocks(page)],
    ids=name_of,
)
def test_python_in_documents_runs_in_order(document, tmp_path, monkeypatch):
    """Runs the blocks of one document in one namespace, beside a small results folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(plt, "show", lambda: None)
    rows = [study_helpers.row(trial) for trial in range(3)]
    table.write_rows(tmp_path / "outputs" / "results" / "belief-0123", rows, {"config": {}})
    namespace: dict[str, object] = {}
    for block in code_blocks(document):
        if block.mark == "excerpt":
            continue
        if block.mark is not None:
            assert block.code == (ROOT / block.mark.removeprefix("file: ")).read_text()
        source = compile("\n" * block.line + block.code, str(document), "exec")
        exec(source, namespace)
    plt.close("all")


def test_nobody_is_told_to_install_from_an_index():
    """Reads documents, messages and settings; the package is on no index, a checkout has it."""
    sources = [*(ROOT / "src").rglob("*.py"), *(ROOT / "conf").rglob("*.yaml"), *DOCUMENTS]
    for path in sources:
        assert not re.search(r"pip install.*mppi-belief|mppi-belief\[", path.read_text()), path


def documented_runs() -> list[str]:
    """Returns the arguments of every `mppi-belief run` in README and docs/commands.md."""
    page, _, _ = commands_page.PAGE.read_text().partition(commands_page.START)
    text = (ROOT / "README.md").read_text() + page
    commands = re.findall(r"(?:^    |`)mppi-belief run (.+?)(?:`|  |$)", text, re.MULTILINE)
    return sorted(set(commands))


@pytest.mark.parametrize("arguments", documented_runs())
def test_documented_runs_compose(arguments):
    words = [word for word in shlex.split(arguments) if "=" in word or word == "-m"]
    if "controller=mine" not in words:  # a controller of the reader's own
        assert collect(*words)


def test_the_page_of_commands_has_the_help_of_today():
    page = commands_page.PAGE.read_text()
    assert page == commands_page.with_help(page), "run docs/scripts/commands_page.py"


def test_every_controller_has_a_line_on_the_page_of_commands():
    page = commands_page.PAGE.read_text()
    for path in (ROOT / "conf" / "controller").glob("*.yaml"):
        assert f"| `{path.stem}` |" in page


def test_every_certificate_is_named_wherever_certificates_are():
    modules = {
        path.stem for path in (ROOT / "src/mppi_belief/verify/certificates").glob("[!_]*.py")
    }
    assert modules == set(CERTIFICATE_NAMES)
    theory, paper_map = (
        (ROOT / "docs" / name).read_text() for name in ("theory.md", "paper_map.md")
    )
    for name in CERTIFICATE_NAMES:
        assert f"| `{name}` |" in theory
        assert f"`{name}`" in paper_map
        assert list((ROOT / "tests/verify").glob(f"test_{name}*.py"))
