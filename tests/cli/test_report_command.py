"""`mppi-belief report`: from the files of a run to a page, whatever is missing or broken."""

import copy
import os
import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cli_helpers import Said, call, collect, files_in, python
from mppi_belief.config import compose as composing
from mppi_belief.config.cell import Cell
from mppi_belief.config.conf_files import conf_dir
from mppi_belief.config.request import Request
from mppi_belief.report.build import STUDIES
from report_helpers import failed_trial, random_trials, store_pictured, store_results

TABLE_1 = ["experiment=table_1", "n_trials=12"]
TRIAL = 1  # that the study records
FILES = ["index.html", "table_1.csv", "table_1.md", "table_1.tex"]


collect_anew = composing.collect


@cache
def composed(request: Request) -> list[dict[str, Any]]:
    return collect_anew(request)


@pytest.fixture(autouse=True)
def composed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hydra takes a second for the cells of a study; what it makes of the same arguments is the
    same.
    """

    def collect(request: Request) -> list[dict[str, Any]]:
        return copy.deepcopy(composed(replace(request, command=())))

    monkeypatch.setattr(composing, "collect", collect)


@pytest.fixture
def report(tmp_path, capsys) -> Callable[..., Said]:
    """The command, in this process and a folder of its own."""
    return lambda *args: call(tmp_path, capsys, "report", *args)


def cells(*args: str) -> list[Cell]:
    return [Cell(config) for config in collect(*args)]


def source(**changes: Any) -> dict[str, Any]:
    run = {
        "command": ["mppi-belief", "run", *TABLE_1],
        "started": "2025-01-01T10:00:00+00:00",
        "elapsed": 60.0,
    }
    return (
        run
        | {"commit": "4a7f400", "dirty": False, "algorithm": 1, "versions": {"jaxlib": "0.7.1"}}
        | changes
    )


def fill(root: Path, *args: str, n: int = 12, **changes: Any) -> list[Cell]:
    """Results of every cell of a study, as its run leaves them but for the pictures."""
    filled = cells(*args)
    rng = np.random.default_rng(1)
    for cell in filled:
        folder = store_results(
            root,
            cell,
            random_trials(rng, range(n), 0.25, 50.0),
            [1e-3, 2e-3, 3e-3],
            source(**changes),
        )
        assert folder.is_dir()
    return filled


@pytest.fixture
def root(tmp_path) -> Path:
    return tmp_path / "outputs" / "results"


@pytest.fixture
def folder(tmp_path) -> Path:
    return tmp_path / "outputs" / "report"


def test_complete_results_become_a_page_and_tables(report, root, folder):
    filled = fill(root, *TABLE_1)
    ended = report(*TABLE_1)
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.endswith("report: outputs/report/index.html\n")
    assert "missing" not in ended.out
    assert set(FILES) <= set(files_in(folder))
    table = pd.read_csv(folder / "table_1.csv")
    costs = [
        pd.concat(map(pd.read_parquet, (root / cell.id).glob("*.parquet")))["cost"].mean()
        for cell in filled
    ]
    np.testing.assert_allclose(table["cost"], costs, rtol=1e-12)
    assert table["controller"].tolist() == ["belief", "ce", "pipf", "ilqg"]
    page = (folder / "index.html").read_text()
    for name, cost in zip(("MPPI-Belief", "CE-MPPI", "PIPF", "EKF-iLQG"), costs, strict=True):
        for text in (
            ended.out,
            page,
            (folder / "table_1.tex").read_text(),
            (folder / "table_1.md").read_text(),
        ):
            assert name in text
            assert f"{cost:.1f}" in text
    assert "4a7f400" in page
    assert not [name for name in files_in(folder) if name.startswith(".")]


def test_a_run_is_read_and_nothing_is_run_or_changed(report, root):
    filled = fill(root, *TABLE_1)
    before = {path: path.stat().st_mtime_ns for path in root.rglob("*")}
    report(*TABLE_1)
    assert {path: path.stat().st_mtime_ns for path in root.rglob("*")} == before
    assert len(filled) == 4


def test_a_second_call_writes_the_same_bytes(report, root, folder):
    for cell in fill(root, *TABLE_1)[:2]:
        store_pictured(root / cell.id, TRIAL)
    assert report(*TABLE_1).code == 0
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert {
        "figure_1.png",
        "figure_1.pdf",
        "matching.png",
        "matching.pdf",
        "animation.gif",
        *FILES,
    } <= set(before)
    for path in folder.iterdir():
        os.utime(path, (0, 0))
    assert report(*TABLE_1).code == 0
    after = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert sorted(name for name in before if before[name] != after.get(name)) == []
    assert set(after) == set(before)
    assert all(path.stat().st_mtime > 0 for path in folder.iterdir())
    assert b"animation.gif" in after["index.html"]


def test_missing_cells_and_trials_are_told_with_the_command_that_runs_them(report, root, folder):
    first, second, _, _ = cells(*TABLE_1)
    rng = np.random.default_rng(1)
    store_results(root, first, random_trials(rng, range(12), 0.0, 50.0))
    store_results(root, second, random_trials(rng, range(3, 12), 0.0, 50.0))
    ended = report(*TABLE_1)
    assert (ended.code, ended.err) == (3, "")
    missing, where = ended.out.splitlines()[-2:]
    sentence, _, line = missing.partition("; ")
    assert sentence == "missing: 27 trials in 3 of 4 cells of table_1"
    assert sorted(line.split()) == sorted(["mppi-belief", "run", *TABLE_1])
    assert where == "report: outputs/report/index.html"
    assert set(FILES) <= set(files_in(folder))
    assert "27 trials are missing" in (folder / "index.html").read_text()
    assert pd.read_csv(folder / "table_1.csv")["trials"].tolist() == [12, 9, 0, 0]


def test_without_any_results_there_is_a_page_that_says_so(report, folder):
    ended = report(*TABLE_1)
    assert (ended.code, ended.err) == (3, "")
    assert "missing: 48 trials in 4 of 4 cells of table_1" in ended.out
    assert files_in(folder) == ["index.html"]


def test_failed_trials_are_not_missing(report, root, folder):
    for cell in cells(*TABLE_1):
        store_results(
            root,
            cell,
            [
                *random_trials(np.random.default_rng(1), range(10), 0.0, 50.0),
                failed_trial(10),
                failed_trial(11),
            ],
        )
    ended = report(*TABLE_1)
    assert ended.code == 0
    assert ended.err.splitlines() == [
        f"{cell.id}: 2 error, e.g. trial 10: oh dear" for cell in cells(*TABLE_1)
    ]
    assert pd.read_csv(folder / "table_1.csv")["failed"].tolist() == [2] * 4
    assert "8 trials failed" in (folder / "index.html").read_text()


def test_cells_whose_trials_all_failed_do_not_stop_it(report, root, folder):
    for cell in cells(*TABLE_1):
        store_results(root, cell, [failed_trial(trial) for trial in range(12)])
    ended = report(*TABLE_1)
    assert ended.code == 0
    assert ended.err.count(": 12 error, e.g. trial 0: oh dear") == 4
    assert "48 trials failed" in (folder / "index.html").read_text()


def test_the_command_that_is_told_runs_the_missing_trials_of_these_settings(
    report, root, folder, tmp_path
):
    settings = [
        "seed=3",
        "n_trials=5",
        f"results_dir={tmp_path / 'my results'}",
        "cost.goal=[7, 1, 0, 0]",
    ]
    ended = report("experiment=reference_scenario", *settings)
    assert ended.code == 3
    (line,) = [line for line in ended.out.splitlines() if line.startswith("missing")]
    word, command, *args = shlex.split(line.partition("; ")[2])
    assert (word, command) == ("mppi-belief", "run")
    assert sorted(args) == sorted(["experiment=reference_scenario", *settings])


def spoil(folder: Path) -> list[str]:
    """Files that are none of ours or no longer whole, and their names."""
    (part, *_) = sorted(folder.glob("part-*.parquet"))
    (folder / "part-torn.parquet").write_bytes(part.read_bytes()[:-30])
    (folder / "part-empty.parquet").touch()
    pq.write_table(pa.table({"trial": [0], "note": ["not ours"]}), folder / "part-foreign.parquet")
    (folder / "paths-noise.parquet").write_bytes(b"PAR1" + bytes(range(256)) + b"PAR1")
    return [
        "part-torn.parquet",
        "part-empty.parquet",
        "part-foreign.parquet",
        "paths-noise.parquet",
    ]


def test_files_that_cannot_be_read_are_named_once_and_skipped(report, root, folder):
    fill(root, *TABLE_1)
    fill(root, "experiment=theta_sweep", "n_trials=12")  # its cell of theta = 1 is Table I's
    clean = report(*TABLE_1)
    (cell, *_) = cells(*TABLE_1)
    names = spoil(root / cell.id)
    ended = report("experiment=table_1,theta_sweep", "n_trials=12")
    assert (ended.code, ended.err) == (0, "")
    page = (folder / "index.html").read_text()
    for name in names:
        (line,) = [line for line in ended.out.splitlines() if name in line]
        assert cell.id in line
        assert "left out" in line
        assert page.count(f"{cell.id}/{name}") == 1
    assert ended.out.startswith(clean.out.partition("report: ")[0])
    assert "Traceback" not in ended.out


def test_small_files_that_are_torn_do_not_stop_it(report, root, folder):
    (cell, *_) = fill(root, *TABLE_1)
    store_pictured(root / cell.id, TRIAL)
    for name in ("timing", "scene", f"recording-{TRIAL}"):
        path = root / cell.id / f"{name}.json"
        path.write_text(path.read_text()[:-5])
    ended = report(*TABLE_1)
    assert (ended.code, ended.err) == (0, "")
    assert set(FILES) <= set(files_in(folder))
    assert pd.read_csv(folder / "table_1.csv")["time"].isna().tolist() == [
        True,
        False,
        False,
        False,
    ]


def test_make_report_runs_the_studies_that_the_report_shows():
    makefile = (conf_dir().parent / "Makefile").read_text()
    assert re.search(r"^STUDIES := (.*)$", makefile, re.MULTILINE)[1].split() == list(STUDIES)


BAD = [
    "experiment=tabel_1",
    "experiment=",
    "experiment=none,nothing",
    "experiment=table_1 theta=abc",
    "experiment=none n_trials=0",
    "experiment=table_1 contoller=ce",
    "experiment=none results_dir=",
    "experiment=none report_dir=",
    "experiment=reference_scenario n_trials=1,2",
    "experiment=table_1 --unknown",
    "table_1",
]


@pytest.mark.parametrize("line", BAD)
def test_bad_input_is_one_line_and_exit_code_2_and_leaves_no_trace(line, report, tmp_path):
    ended = report(*shlex.split(line))
    assert (ended.code, ended.out) == (2, "")
    assert re.fullmatch(r"mppi-belief: \S.*\n", ended.err)
    assert files_in(tmp_path) == []


def test_an_unknown_study_is_told_with_those_there_are(report):
    ended = report("experiment=tabel_1")
    assert "table_1" in ended.err
    assert "theta_sweep" in ended.err


def test_a_folder_that_cannot_be_written_is_exit_code_74(report, root, tmp_path):
    fill(root, *TABLE_1)
    (tmp_path / "taken").write_text("a file")
    ended = report(*TABLE_1, "report_dir=taken")
    assert ended.code == 74
    assert re.fullmatch(r"mppi-belief: cannot write \S.*taken.*\n", ended.err)
    assert (tmp_path / "taken").read_text() == "a file"


def test_help_names_studies_and_exit_codes(report, tmp_path):
    for flag in ("--help", "-h"):
        ended = report(flag)
        assert (ended.code, ended.err) == (0, "")
        assert all(name in ended.out for name in STUDIES)
        assert all(re.search(rf"\b{code}\b", ended.out) for code in (0, 2, 3, 74))
    assert files_in(tmp_path) == []


def test_flags_that_only_print_do_not_end_in_a_traceback(report, tmp_path):
    ended = report("experiment=table_1", "--cfg", "job")
    assert ended.code in (0, 2)
    assert files_in(tmp_path) == []


def test_it_does_not_wait_for_jax(root, tmp_path):
    fill(root, *TABLE_1)
    code = f"""import sys
from mppi_belief.cli.main import main
for args in (["--help"], {TABLE_1}):
    sys.argv = ["mppi-belief", "report", *args]
    print("ended", main(), "jax" in sys.modules)
"""
    ended = python(code, tmp_path).splitlines()
    assert [line for line in ended if line.startswith("ended")] == ["ended 0 False"] * 2


def test_a_study_of_a_users_own_has_a_section(report, root, folder, tmp_path):
    (tmp_path / "mine" / "experiment").mkdir(parents=True)
    (tmp_path / "mine" / "experiment" / "two_seeds.yaml").write_text(
        "# @package _global_\nhydra:\n  mode: MULTIRUN\n  sweeper:\n    params:\n      seed: 4,5\n"
    )
    study = ["--config-dir", str(tmp_path / "mine"), "experiment=two_seeds", "n_trials=12"]
    ended = report(*study)
    assert (ended.code, ended.err) == (3, "")
    missing, _, command = ended.out.splitlines()[-2].partition("; ")
    assert missing == "missing: 24 trials in 2 of 2 cells of two_seeds"
    assert [cell.id for cell in fill(root, *study)] == [
        cell.id for cell in cells(*shlex.split(command)[2:])
    ]
    ended = report(*study)
    assert (ended.code, ended.err) == (0, "")
    assert report(*study[2:], *study[:2]) == ended
    tables = ["two_seeds.csv", "two_seeds.md", "two_seeds.tex"]
    pictures = ["two_seeds_cells.pdf", "two_seeds_cells.png"]
    assert files_in(folder) == ["index.html", *tables, *pictures]
    assert pd.read_csv(folder / "two_seeds.csv")["seed"].tolist() == [4, 5]
    page = (folder / "index.html").read_text()
    assert re.search(r"<h1>\s*two_seeds</h1>", page)
    assert "two_seeds.csv" in page


def test_another_folder_and_other_settings_are_obeyed(report, tmp_path):
    settings = [
        "experiment=reference_scenario",
        "seed=9",
        "n_trials=4",
        "results_dir=elsewhere/results",
    ]
    fill(tmp_path / "elsewhere" / "results", *settings, n=6)
    ended = report(*settings, "report_dir=elsewhere/report")
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.endswith("report: elsewhere/report/index.html\n")
    assert files_in(tmp_path) == ["elsewhere"]
    assert (
        pd.read_csv(tmp_path / "elsewhere" / "report" / "reference_scenario.csv")["trials"].tolist()
        == [4] * 2
    )


BOAT = ["--config-dir", str(conf_dir().parent / "examples" / "boat")]


def texts_of(folder: Path) -> str:
    """Returns all text that a report has written, without the pictures in its page."""
    texts = [
        path.read_text()
        for path in folder.iterdir()
        if path.suffix in (".html", ".tex", ".md", ".csv")
    ]
    return re.sub(r"data:image/[^\"]*|<style>.*?</style>", "", "\n".join(texts), flags=re.DOTALL)


def assert_nothing_of_the_paper(folder: Path) -> None:
    """Fails where a report of other settings speaks of the paper or shows its numbers."""
    text = texts_of(folder)
    for word in ("Das and Tanaka", "Table I", "Fig. 1", "paper", "56.5", "23.0", "50.5"):
        assert word not in text, word
    assert not [name for name in files_in(folder) if name.startswith(("table_1.", "figure_1"))]


@pytest.mark.parametrize(
    ("words", "n", "title"),
    [
        ([*BOAT, "-m", "system=boat", "theta=0,0.1"], 2, "MPPI-Belief on boat by theta"),
        ([*BOAT, "system=boat"], 1, "MPPI-Belief on boat"),
        ([*BOAT, "experiment=crossing"], 4, "Crossing the river"),
        (["-m", "problem.steps=20,30"], 2, "MPPI-Belief on light_dark by problem.steps"),
        (
            ["experiment=table_1", "problem.steps=20"],
            4,
            "table_1 with problem.steps=20 n_trials=12",
        ),
        ([*BOAT, "experiment=table_1", "system=boat"], 4, "table_1 with system=boat n_trials=12"),
        (["-m", "seed=1,2"], 2, "MPPI-Belief on light_dark by seed"),
    ],
    ids=["sweep", "cell", "study", "our system", "changed study", "boats in Table I", "seeds"],
)
def test_any_other_problem_has_a_report_of_its_own(words, n, title, report, root, folder):
    words = [*words, "n_trials=12"]
    assert len(fill(root, *words)) == n
    ended = report(*words)
    assert (ended.code, ended.err) == (0, "")
    assert f"<h1>{title}</h1>" in (folder / "index.html").read_text()
    assert_nothing_of_the_paper(folder)
    stems = {name.partition(".")[0] for name in files_in(folder) if name.endswith(".tex")}
    assert "table_1" not in stems
    assert stems


def test_the_command_for_the_missing_trials_of_a_sweep_runs_that_sweep(report):
    words = [*BOAT, "-m", "system=boat", "theta=0,0.1", "n_trials=12"]
    ended = report(*words)
    assert ended.code == 3
    (line,) = [line for line in ended.out.splitlines() if line.startswith("missing")]
    sentence, _, command = line.partition("; ")
    assert sentence == "missing: 24 trials in 2 of 2 cells of sweep"
    args = shlex.split(command)[2:]
    assert [cell.id for cell in cells(*args)] == [cell.id for cell in cells(*words)]


def test_a_part_of_the_papers_study_keeps_its_numbers(report, root, folder):
    words = ["experiment=table_1", "controller=belief,ce", "seed=3", "n_trials=12"]
    fill(root, *words)
    assert report(*words).code == 0
    text = texts_of(folder)
    assert "56.5 ± 5.2" in text
    assert "46.1" not in (folder / "table_1.md").read_text()  # EKF-iLQG is not among the cells
    assert "Das and Tanaka" in text


def test_settings_that_change_no_cell_leave_the_papers_report(report, folder, tmp_path):
    ended = report("n_trials=3", "seed=2", f"results_dir={tmp_path / 'none'}")
    assert ended.code == 3
    for name in STUDIES:
        assert f" of {name}; " in ended.out
    assert "certificates" in ended.out
    assert "Das and Tanaka" in (folder / "index.html").read_text()


def test_the_title_and_question_of_a_study_make_no_other_cell():
    (cell,) = cells("theta=1")
    (titled,) = cells("theta=1", "title=Mine", "question='What, then?'")
    assert titled.id == cell.id
    assert titled.config["swept"] == cell.config["swept"]
