"""LaTeX tables: they fit an IEEE column, and LaTeX itself agrees where it is installed."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from mppi_belief.report.cell_results import CellResults
from mppi_belief.report.latex import (
    COLUMN_WIDTH,
    PAGE_WIDTH,
    LatexTable,
    escaped,
    estimated_width,
    render_latex,
)
from mppi_belief.report.sections.own_study import OwnStudy, own_study_latex
from mppi_belief.report.sections.table_1 import table_1_latex
from report_helpers import cell_of, results_of, trial_rows

IEEE_COLUMN = 252.0  # pt, of IEEEtran
METHODS = ("belief", "ce", "pipf", "ilqg")
SOURCE = {"processor": "AMD EPYC_7 & more"}
PDFLATEX = shutil.which("pdflatex")


def has_ieee_class() -> bool:
    """Returns whether LaTeX, IEEEtran and booktabs are installed."""
    if PDFLATEX is None:
        return False
    names = ("IEEEtran.cls", "booktabs.sty", "ptmr7t.tfm")
    return all(subprocess.run(["kpsewhich", name], capture_output=True).stdout for name in names)


with_latex = pytest.mark.skipif(not has_ieee_class(), reason="no LaTeX with IEEEtran is installed")


def widest_cells() -> list[CellResults]:
    """Returns Table I with numbers as long as they may become: 150.0 +- 60.5, 50.0 [..., ...]."""
    cells = [
        results_of(cell_of(method), trial_rows(200, 100, (150.0, 60.5)), 200, [SOURCE])
        for method in METHODS
    ]
    return [cell._replace(seconds=[0.000151] * 5) for cell in cells]


def rows_of(latex: str) -> list[list[str]]:
    """Returns the texts of all rows, the head included."""
    lines = [line for line in latex.splitlines() if line.endswith(r"\\")]
    return [line.removesuffix(r" \\").split(" & ") for line in lines]


def test_table_1_fits_a_column_whatever_its_numbers():
    latex = table_1_latex(widest_cells())
    assert latex.count(r"\begin{table}") == 1
    assert estimated_width(rows_of(latex)) <= COLUMN_WIDTH < IEEE_COLUMN


def test_table_1_has_times_trials_and_machine():
    latex = table_1_latex(widest_cells())
    head, ours, papers, *_ = rows_of(latex)
    assert head == ["Method", "", "Trials", "Cost", r"Collision (\%)", "Time (ms)"]
    assert ours[2] == papers[2] == "200"
    assert ours[-1] == "0.151"  # three digits: not "0.2"
    assert papers[-1] == "18"
    assert r"Times measured here on AMD EPYC\_7 \& more." in latex


def test_times_of_a_busy_machine_are_marked():
    cells = widest_cells()
    assert "*" not in table_1_latex(cells)
    latex = table_1_latex([cells[0]._replace(busy=True), *cells[1:]])
    assert [texts[-1] for texts in rows_of(latex)][1:4] == ["0.151*", "18", "0.151"]
    assert "*: while other work kept the machine busy." in latex


@with_latex
@pytest.mark.parametrize("kind", ["table_1", "own", "wide"])
def test_latex_agrees_with_the_estimated_width(kind, tmp_path):
    latex = {"table_1": table_1_latex(widest_cells()), "own": own_latex(1), "wide": own_latex(9)}[
        kind
    ]
    assert latex.count(r"\begin{table*}") == (kind == "wide")
    width = measured_width(latex, tmp_path)
    assert width == pytest.approx(estimated_width(rows_of(latex)), rel=0.01)
    assert width <= (516.0 if kind == "wide" else IEEE_COLUMN)


def own_latex(keys: int) -> str:
    """Returns the table of a study that sweeps so many keys."""
    cells = [
        results_of(
            cell_of("belief", **{f"system.key_{j}": k + j for j in range(keys)}), trial_rows(9)
        )
        for k in range(3)
    ]
    return own_study_latex(OwnStudy("mine", "Mine", cells))


def measured_width(latex: str, folder: Path) -> float:
    """Returns the width of the tabular in pt, as LaTeX sets it; fails where LaTeX complains."""
    tabular = re.search(r"\\begin\{tabular\}.*\\end\{tabular\}", latex, re.DOTALL)[0]
    gap = re.search(r"\\setlength\{\\tabcolsep\}\{[^}]*\}", latex)[0]
    text = rf"""\documentclass[letterpaper,10pt,conference]{{IEEEtran}}
\usepackage{{booktabs,graphicx}}
\begin{{document}}
{{\footnotesize{gap}\sbox0{{{tabular}}}\typeout{{WIDTH \the\wd0}}}}
{latex}
\end{{document}}
"""
    (folder / "t.tex").write_text(text)
    command = [PDFLATEX, "-interaction=nonstopmode", "-halt-on-error", "t.tex"]
    ended = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stdout[-2000:]
    assert "Overfull" not in ended.stdout
    return float(re.search(r"WIDTH ([\d.]+)pt", ended.stdout)[1])


def test_wider_tables_span_the_page_or_are_scaled():
    def table(columns: int) -> str:
        row = ["some text here"] * columns
        return render_latex(LatexTable("caption", "tab:x", ["head"] * columns, [[row]]))

    assert r"\begin{table}" in table(2)
    assert r"\begin{table*}" in table(6)
    assert r"\resizebox" not in table(6)
    assert estimated_width([["some text here"] * 20]) > PAGE_WIDTH
    assert r"\resizebox{\textwidth}{!}{%" in table(20)
    assert table(20).startswith("% needs booktabs and graphicx\n")


def test_plain_text_is_escaped():
    assert escaped("a_b & 50 % #1 {x} $") == r"a\_b \& 50 \% \#1 \{x\} \$"
    assert escaped("a\\b~c^d<e>") == (
        r"a\textbackslash{}b\textasciitilde{}c\textasciicircum{}d\textless{}e\textgreater{}"
    )
    assert escaped("Zähler") == "Z?hler"
