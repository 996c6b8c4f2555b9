"""The map from the paper to the code is true: its paths and its functions exist."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "mppi_belief"
PAPER_MAP = ROOT / "docs" / "paper_map.md"
THEORY = ROOT / "docs" / "theory.md"
A_PATH = re.compile(r"[\w.-]+(/[\w.-]*)+|[\w-]+\.(py|md|yaml)")
A_FUNCTION = re.compile(r"[a-z_]\w*(\.\w+)+")


def code_words(document: Path) -> list[str]:
    """Return the words in backticks of a document."""
    return re.findall(r"`([^`\n]+)`", document.read_text())


def test_every_path_exists():
    for document in (THEORY, PAPER_MAP):
        for word in code_words(document):
            if word.startswith(("outputs/", "controller/")):
                continue  # written by the commands; a group of the configuration
            if A_PATH.fullmatch(word):
                candidates = [ROOT / word, PACKAGE / word]
                assert any(path.exists() for path in candidates), f"{document.name}: {word}"


def test_every_function_exists():
    for word in code_words(PAPER_MAP):
        if A_FUNCTION.fullmatch(word) and not word.startswith(("controller.", "filter.")):
            if A_PATH.fullmatch(word):
                continue
            *module, name = word.split(".")
            path = PACKAGE.joinpath(*module).with_suffix(".py")
            assert path.exists(), word
            definitions = {
                node.name
                for node in ast.parse(path.read_text()).body
                if isinstance(node, ast.FunctionDef | ast.ClassDef)
            }
            assert name in definitions, word


def test_every_section_of_the_paper_leads_to_a_folder():
    sections = PAPER_MAP.read_text().split("## ")[1]
    for number in ("II", "III", "IV", "V-A", "V-B", "V-C", "VI", "VII"):
        assert re.search(rf"^\|.*\b{number}\b.*`\w+[/.]", sections, re.MULTILINE), number
