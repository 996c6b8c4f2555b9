"""Writes tables in LaTeX that fit the columns of an IEEE paper.

A table is set in 8 points with booktabs. Its width is estimated from the metrics of Times; a table
that is wider than one column of the page spans both, and one that is wider still is scaled.
"""

import re
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

COLUMN_WIDTH = 245.7  # pt; ieeeconf, 3.4 in; IEEEtran has 252 pt
PAGE_WIDTH = 505.0  # pt; ieeeconf, 7 in; IEEEtran has 516 pt
FONT_SIZE = 8.0  # pt, \footnotesize of both classes
GAP = 3.0  # pt, \tabcolsep
RELATION_GAP = 3.6  # pt, twice \medmuskip, the space around +- in 8 points
COMMANDS = {character: f"\\{character}" for character in "&%$#_{}"} | {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
}  # what prints a character that LaTeX would take for a command


class LatexTable(NamedTuple):
    """Holds a table whose texts are LaTeX already."""

    caption: str
    label: str
    headings: Sequence[str]
    groups: Sequence[Sequence[Sequence[str]]]  # rows in groups, with a little space between groups


def escaped(text: str) -> str:
    """Returns plain text as LaTeX; characters outside ASCII become a question mark."""
    ascii_text = text.encode("ascii", "replace").decode()
    return "".join(COMMANDS.get(character, character) for character in ascii_text)


def plus_minus(value: float, spread: float) -> str:
    """Returns "value +- spread" with one decimal, in mathematics."""
    return rf"${value:.1f} \pm {spread:.1f}$"


def render_latex(table: LatexTable) -> str:
    """Returns a table environment: `table`, or `table*` where it is wider than a column."""
    rows = [list(table.headings)]
    for group in table.groups:
        rows += [list(row) for row in group]
    width = estimated_width(rows)
    environment = "table" if width <= COLUMN_WIDTH else "table*"
    is_scaled = width > PAGE_WIDTH
    bodies = ["".join(f"{_line(row)}\n" for row in group) for group in table.groups]
    columns = "l" + "c" * (len(table.headings) - 1)
    lines = [
        f"% needs {'booktabs and graphicx' if is_scaled else 'booktabs'}",
        rf"\begin{{{environment}}}[t]",
        r"\centering",
        r"\footnotesize",
        rf"\caption{{{table.caption}}}",
        rf"\label{{{table.label}}}",
        rf"\setlength{{\tabcolsep}}{{{GAP:g}pt}}",
        *([r"\resizebox{\textwidth}{!}{%"] if is_scaled else []),
        rf"\begin{{tabular}}{{@{{}}{columns}@{{}}}}",
        r"\toprule",
        _line(table.headings),
        r"\midrule",
        "\\addlinespace[2pt]\n".join(bodies).rstrip("\n"),
        r"\bottomrule",
        r"\end{tabular}" + ("}" if is_scaled else ""),
        rf"\end{{{environment}}}",
    ]
    return "\n".join(lines) + "\n"


def _line(texts: Sequence[str]) -> str:
    return " & ".join(texts) + r" \\"


def estimated_width(rows: Sequence[Sequence[str]]) -> float:
    """Returns the width of a tabular with these rows in pt, from the metrics of Times."""
    columns = [max(map(_text_width, texts)) for texts in zip(*rows, strict=True)]
    return sum(columns) + 2 * GAP * (len(columns) - 1)


@cache
def _text_width(latex: str) -> float:
    """Returns the width of a text in pt; commands count as the characters that they print."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    printed = re.sub(r"\\pm\b", "\u00b1", latex)
    printed = re.sub(r"\\text[a-z]+\{\}", "m", printed)
    printed = re.sub(r"[\\$]", "", printed)
    if not printed.strip():
        return 0.0
    font = FontProperties(family="STIXGeneral")
    advance = TextPath((0, 0), f"{printed}|", FONT_SIZE, prop=font).get_extents().x1
    bar = TextPath((0, 0), "|", FONT_SIZE, prop=font).get_extents().x1
    return float(advance - bar) + RELATION_GAP * printed.count("\u00b1")
