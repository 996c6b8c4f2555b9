"""Reads the documents of the repository and their blocks of Python."""

import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = sorted(
    [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "experiments").rglob("*.md")]
)
# A block of code with the comment before it: nothing, `excerpt` (not run), or `file: PATH`.
CODE_BLOCK = re.compile(
    r"(?:^<!-- (?P<mark>excerpt|file: \S+) -->\n)?^```python\n(?P<code>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)


class CodeBlock(NamedTuple):
    """Represents a block of Python in a document."""

    document: Path
    line: int  # of the document, from 1
    mark: str | None
    code: str


def code_blocks(document: Path) -> list[CodeBlock]:
    """Returns the blocks of Python of a document."""
    text = document.read_text()
    return [
        CodeBlock(document, text.count("\n", 0, match.start()) + 1, match["mark"], match["code"])
        for match in CODE_BLOCK.finditer(text)
    ]
