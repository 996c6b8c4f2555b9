"""The measures of style find what they are meant to find, and only that."""

from pathlib import Path

import pytest

import style_measures as measures
import style_report
from style_checkout import modules

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def write(tmp_path):
    """Returns a function that writes modules into a checkout and reads them."""

    def write_modules(**texts):
        folder = tmp_path / "src" / "mppi_belief"
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            (folder / f"{name}.py").write_text(text)
        return modules(tmp_path, "src")

    return write_modules


@pytest.mark.parametrize(
    ("code", "count"),
    [("a, b = 1, 2", 1), ("a, b = b, a", 0), ("a, b = divmod(7, 2)", 0), ("a = 1, 2", 0)],
)
def test_tuple_assignments_are_found_but_swaps_and_calls_are_allowed(write, code, count):
    assert len(measures.tuple_assignments(write(module=code))) == count


@pytest.mark.parametrize(
    ("code", "count"),
    [
        ("told = 1", 1),
        ("def f(seen): ...", 1),
        ("for off in []: ...", 1),
        ("class C:\n    kept: int", 1),
        ("class C:\n    def __eq__(self, other): ...", 0),
        ("belief_seen = x.at[0]", 0),
    ],
)
def test_private_words_are_found_where_they_name_something(write, code, count):
    assert len(measures.private_words(write(module=code))) == count


@pytest.mark.parametrize(
    ("docstring", "clauses", "verbless"),
    [
        ("Returns the gain.", 0, 0),
        ("Compute the gain.", 0, 0),
        ("Carries out a plan.", 0, 0),
        ("What is written when.", 1, 1),
        ("The same of a mixture.", 0, 1),
    ],
)
def test_docstrings_start_with_a_verb(write, docstring, clauses, verbless):
    source = write(module=f'def f():\n    """{docstring}"""')
    assert len(measures.clause_docstrings(source)) == clauses
    assert len(measures.verbless_docstrings(source)) == verbless


def test_a_name_that_two_modules_define_is_found_once(write):
    source = write(one="class Stored: ...\nx = 1", two="Stored = 1", three="def y(): ...")
    (finding,) = measures.shared_names(source)
    assert str(finding).startswith("src/mppi_belief/one.py:1: `Stored` is also defined in")
    assert str(finding).endswith("two.py")


def test_lines_functions_and_comments_are_counted(write):
    source = write(module="# a comment\n\ndef f():\n    pass\n\n\n" + "x" * 101 + "\n")
    assert [finding.line for finding in measures.long_lines(source)] == [7]
    assert measures.function_lengths(source) == [2]
    assert measures.comment_lines(source) == 1
    assert measures.code_lines(source) == 4


def test_private_attributes_of_the_package_are_found(write):
    code = "from mppi_belief.results import _TYPES\nself._x\npool._workers\nrow._replace(a=1)"
    texts = [finding.text for finding in measures.reached_privates(write(module=code))]
    assert texts == ["private attribute: _TYPES", "private attribute: _workers"]


def test_the_report_has_a_column_per_checkout(capsys):
    assert style_report.main(["--before", str(ROOT)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "names in the import rule" in "".join(lines)
    assert all(line.count("|") == 4 for line in lines)


def test_a_broken_rule_is_named_with_its_file_and_line(write, tmp_path, capsys):
    write(module="a, b = 1, 2\n")
    assert style_report.main(["--of", str(tmp_path), "--check", "src"]) == 1
    assert capsys.readouterr().out.startswith("src/mppi_belief/module.py:1: tuple assigned")
    assert style_report.main(["--of", str(tmp_path), "--check", "--report-only", "src"]) == 0
