"""Reads the Python files of a checkout for the measures of `style_measures.py`."""

import ast
import tokenize
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple


class Finding(NamedTuple):
    """Represents one place in the code that a measure counts."""

    path: Path  # relative to the root of the checkout
    line: int  # from 1
    text: str  # what is wrong there

    def __str__(self) -> str:
        """Returns `path:line: text`, which editors and CI turn into a link."""
        return f"{self.path}:{self.line}: {self.text}"


@dataclass(frozen=True)
class Module:
    """Holds the text of one Python file and its syntax tree."""

    root: Path  # of the checkout
    path: Path  # relative to the root

    @cached_property
    def text(self) -> str:
        """Returns the text of the file."""
        with tokenize.open(self.root / self.path) as file:
            return file.read()

    @cached_property
    def lines(self) -> list[str]:
        """Returns the lines of the file without their ends."""
        return self.text.splitlines()

    @cached_property
    def tree(self) -> ast.Module:
        """Returns the syntax tree of the file."""
        return ast.parse(self.text)

    @cached_property
    def nodes(self) -> list[ast.AST]:
        """Returns all nodes of the syntax tree."""
        return list(ast.walk(self.tree))

    def finding(self, line: int, text: str) -> Finding:
        """Returns a finding at a line of this file."""
        return Finding(self.path, line, text)


def modules(root: Path, *folders: str) -> list[Module]:
    """Returns the Python files below the named folders of a checkout, in order of path."""
    paths: set[Path] = set()
    for folder in folders:
        start = root / folder
        paths.update([start] if start.is_file() else start.rglob("*.py"))
    return [Module(root, path.relative_to(root)) for path in sorted(paths)]
