"""`mppi-belief results`: what is there is told, exported, checked and merged, and nothing of it is
lost.
"""

import csv
import io
import math
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cli_helpers import Said, call, files_in
from mppi_belief.config.cell import ALGORITHM_VERSION, Cell
from mppi_belief.results import compact as compaction
from mppi_belief.results import files
from mppi_belief.results import table as results
from mppi_belief.results.contents import read_cell, read_rows
from report_helpers import cell_of, failed_trial, store_pictured, store_results
from results_helpers import EXTREMES, bits
from study_helpers import row

CELL = cell_of(theta=1.0)
OTHER = cell_of("ce", theta=0.0)


def source(**changes: Any) -> dict[str, Any]:
    run = {
        "command": ["mppi-belief", "run", "theta=1"],
        "started": "2025-01-01T10:00:00+00:00",
        "elapsed": 60.0,
    }
    measured = {
        "commit": "4a7f400c0ffee",
        "dirty": False,
        "algorithm": ALGORITHM_VERSION,
        "processor": "Z80",
    }
    return run | measured | {"versions": {"jaxlib": "0.7.1", "mppi-belief": "0.1.0"}} | changes


def rows_of(cell: Cell, n: int, first: int = 0, **values: Any) -> list[dict[str, Any]]:
    """Rows as the cell's trials leave them."""
    values_of_run = {
        "theta": cell.config["controller"]["path_cost"]["theta"],
        "w_obs": cell.config["cost"]["w_obs"],
        "controller": cell.config["names"]["controller"],
    }
    return [row(trial, **values_of_run, **values) for trial in range(first, first + n)]


@pytest.fixture
def root(tmp_path) -> Path:
    return tmp_path / "outputs" / "results"


@pytest.fixture
def command(tmp_path, capsys) -> Callable[..., Said]:
    """`mppi-belief results` in this process and a folder of its own."""
    return lambda *args, **env: call(tmp_path, capsys, "results", *args, **env)


@pytest.fixture
def cell(root) -> Path:
    """A cell with 25 rows in three files, a path, a scene and times, as a run leaves it."""
    folder = store_results(root, CELL, rows_of(CELL, 25), [1e-3], source())
    store_pictured(folder, 3)
    return folder


def lines(ended: Said) -> list[str]:
    assert ended.code == 0, ended.err
    return ended.out.splitlines()


def test_the_list_has_a_line_a_cell_with_its_statuses_settings_commit_and_age(command, cell, root):
    store_results(
        root,
        OTHER,
        [*rows_of(OTHER, 2), failed_trial(2) | {"status": "crashed"}],
        (),
        source(dirty=True),
    )
    for path in cell.iterdir():
        os.utime(path, (0, time.time() - 7000))
    future = time.time() + 9e6
    os.utime(next((root / OTHER.id).iterdir()), (future, future))
    head, finished, superseded = lines(command())
    assert head.split()[:6] == ["cell", "ok", "crashed", "theta", "w_obs", "seed"]
    assert finished.split()[:6] == [CELL.id, "25", "-", "1", "500", "0"]
    assert superseded.split()[:6] == [OTHER.id, "2", "1", "0", "500", "0"]
    assert finished.split()[6] == str(len(files_in(cell)))
    assert finished.split()[-5:] == ["kB", "2", "h", "4a7f400", str(ALGORITHM_VERSION)]
    assert superseded.split()[-4:] == ["0", "s", "4a7f400+", str(ALGORITHM_VERSION)]


def test_settings_that_differ_are_shown_and_those_that_do_not_are_not(command, root):
    for width in (0.1, 0.2):
        cell = cell_of(**{"cost.obstacle_penalty.width": width, "planner.horizon": 7})
        widened = Cell(cell.config | {"system": {"width": width}})
        store_results(root, widened, rows_of(widened, 1), (), source())
    head, *others = lines(command())
    assert "cost.obstacle_penalty.width" in head
    assert not any(name in head for name in ("planner.horizon", "precision", "note"))
    assert sorted(line.split()[5] for line in others) == ["0.1", "0.2"]


def test_cells_that_no_command_of_today_finds_are_superseded_and_left_out_of_the_export(
    command, cell, root
):
    old = store_results(root, OTHER, rows_of(OTHER, 3), (), source(algorithm=ALGORITHM_VERSION - 1))
    (line,) = (line for line in lines(command()) if OTHER.id in line)
    assert f"superseded: algorithm {ALGORITHM_VERSION - 1}, today {ALGORITHM_VERSION}" in line
    assert {row["cell"] for row in csv.DictReader(lines(command("export", "--csv")))} == {cell.name}
    assert {row["cell"] for row in csv.DictReader(lines(command("export", old.name)))} == {old.name}


def test_an_unreadable_file_is_named_and_the_rest_is_there(command, cell):
    path = min(cell.glob("part-*"))
    path.write_bytes(path.read_bytes()[:-9])
    ended = command()
    assert (ended.code, ended.err.count("\n")) == (0, 1)
    assert str(path.relative_to(cell.parents[2])) in ended.err
    assert ended.out.splitlines()[1].split()[1] == "15"
    assert "1 unreadable" in ended.out


def test_nothing_there_is_said(command, root, tmp_path):
    ended = command()
    assert (ended.code, ended.out, ended.err) == (
        2,
        "",
        "mppi-belief: results_dir=outputs/results: no such folder\n",
    )
    root.mkdir(parents=True)
    assert lines(command()) == ["no results in outputs/results"]
    assert lines(command("verify", f"results_dir={root}")) == [
        "0 cells, 0 files checked: all is well"
    ]


BAD = {
    "shw": "did you mean 'show'",
    "show": "name one cell",
    "show be ce": "name one cell",
    "show x": "unknown cell 'x'",
    "show belife-": "did you mean",
    "show ./nowhere": "not the folder of a cell",
    "show belief- --csv": "an option of mppi-belief results export",
    "export --to": "needs a value",
    "export --too=x": "did you mean '--to'",
    "export --to=outputs": "must name a file",
    "export --csv all.csv": "unknown cell 'all.csv'; see mppi-belief results "
    "results_dir=outputs/results; a file to write into is given with --to FILE",
    "export --csv ./all.csv": "not the folder of a cell; a file to write into is given with --to",
    "export --csv=all.csv": "--csv: takes no value; a file to write into is given with --to FILE",
    "verify seed=1": "unknown key 'seed'",
    "verify results_dir=": "must name a folder",
}


@pytest.mark.parametrize("line", BAD)
def test_bad_input_is_one_line(line, command, cell):
    ended = command(*line.split())
    assert (ended.code, ended.out, ended.err.count("\n")) == (2, "", 1)
    assert ended.err.startswith("mppi-belief: ")
    assert BAD[line] in ended.err


def test_a_cell_is_named_by_its_beginning_or_its_folder(command, cell, root):
    twin = cell_of(theta=2.0)
    store_results(root, twin, rows_of(twin, 1), (), source())
    for word in (CELL.id[:10], CELL.id, str(cell), f"outputs/results/{cell.name}"):
        assert lines(command("show", word))[0] == cell.name
    several = command("show", "belief")
    assert several.code == 2
    assert CELL.id in several.err
    assert twin.id in several.err
    assert f"did you mean {CELL.id}" in command("show", CELL.id[7:15]).err


def test_show_says_where_a_cell_comes_from_and_what_went_wrong(command, root):
    run = source(elapsed=5.0)
    folder = store_results(
        root, CELL, [*rows_of(CELL, 10), failed_trial(10), failed_trial(11)], [1e-3, 3e-3], run
    )
    store_results(
        root,
        CELL,
        rows_of(CELL, 3, first=12),
        (),
        source(commit="b" * 40, started="2025-02-01T00:00:00+00:00"),
    )
    ended = "\n".join(lines(command("show", CELL.id)))
    for text in (
        "theta: 1.0",
        "trials     0..11\n",
        "trials     12..14\n",
        "command    mppi-belief run theta=1\n",
    ):
        assert text in ended
    assert "2 error, e.g. trial 10: oh dear" in ended
    assert f"commit     {'b' * 40}\n" in ended
    assert "machine    Z80" in ended
    assert "15 (2 failed)" in ended
    assert all(name in ended for name in files_in(folder))


def test_an_export_reads_back_bit_for_bit(command, root, tmp_path):
    swept = cell_of(**{"controller.horizon": 7})
    extreme_rows = [
        row | {"cost": value}
        for row, value in zip(rows_of(swept, len(EXTREMES)), EXTREMES, strict=True)
    ]
    store_results(
        root,
        swept,
        [*extreme_rows, failed_trial(8) | {"error": 'a "b",\nc'}],
        (),
        source(dirty=True),
    )
    store_results(root, OTHER, rows_of(OTHER, 1), (), source(commit=None))
    assert lines(command("export", "--csv", "--to", "all.csv")) == ["10 rows of 2 cells in all.csv"]
    with (tmp_path / "all.csv").open(newline="") as file:
        exported = list(csv.DictReader(file))
    assert bits([float(row["cost"]) for row in exported[:8]]) == bits(EXTREMES)
    assert {(row["cell"], row["commit"], row["controller.horizon"]) for row in exported} == {
        (swept.id, "4a7f400c0ffee+", "7"),
        (OTHER.id, "0.1.0", ""),
    }
    assert (exported[8]["error"], exported[8]["collided"], exported[8]["cost"]) == (
        'a "b",\nc',
        "",
        "nan",
    )
    assert (exported[0]["error"], exported[0]["collided"], exported[0]["steps"]) == (
        "",
        "False",
        "3",
    )
    assert command("export").out == (tmp_path / "all.csv").read_text()
    frame = pd.read_csv(io.StringIO(command("export").out))
    assert frame["trial"].tolist() == [*range(9), 0]


def test_one_is_counted_in_the_singular(command, root):
    store_results(root, CELL, rows_of(CELL, 1), (), source())
    assert lines(command("export", "--to", "all.csv")) == ["1 row of 1 cell in all.csv"]
    assert lines(command("verify"))[-1].startswith("1 cell, 1 file checked: all is well")
    assert lines(command("compact"))[-1].startswith("1 cell: 1 file, ")


def test_a_command_is_shown_as_a_shell_takes_it(command, root):
    words = ["mppi-belief", "run", "results_dir=out (1)"]
    store_results(root, CELL, rows_of(CELL, 1), (), source(command=words))
    assert "command    mppi-belief run 'results_dir=out (1)'" in command("show", CELL.id).out


def test_an_export_that_cannot_be_written_is_exit_code_74(command, cell):
    assert command("export", "--to", "/dev/null/all.csv").code == 74


def merged(ended: Said) -> list[str]:
    assert (ended.code, ended.err) == (0, "")
    return ended.out.splitlines()


def test_compaction_keeps_every_result_and_every_source(command, cell):
    store_pictured(cell, 4)
    later = source(started="2025-02-01T00:00:00+00:00", elapsed=1.0)
    store_results(
        cell.parent, CELL, rows_of(CELL, 5, first=30, **{"planner.horizon": 7}), (), later
    )
    before = read_rows(cell)
    paths = read_cell(cell).steps
    messages = merged(command("compact"))
    assert messages[-1].startswith("1 cell: 10 files, ")
    assert "-> 6 files" in messages[-1]
    (part,) = cell.glob("part-*")
    (steps,) = cell.glob("paths-*")
    assert results.result_hash(read_rows(cell)) == results.result_hash(before)
    assert read_cell(cell).steps.equals(paths)
    assert pq.read_table(part)["planner.horizon"].to_pylist() == [None] * 25 + [7] * 5
    first, second = results.read_table(part)[0]["sources"]
    assert (first["trials"], second["trials"]) == ([[0, 24]], [[30, 34]])
    assert {**first, "trials": None} == {**source(), "config": CELL.config, "trials": None}
    assert second["started"] == later["started"]
    assert lines(command("verify"))[-1].endswith("all is well")
    stamps = {path: path.stat().st_mtime_ns for path in (part, steps)}
    merged(command("compact"))  # nothing is left to do
    assert {path: path.stat().st_mtime_ns for path in (part, steps)} == stamps


def test_compaction_takes_the_longest_time_of_a_run_and_lets_go_of_failed_rows(command, root):
    folder = store_results(
        root, CELL, [*rows_of(CELL, 9), failed_trial(9)], (), source(elapsed=5.0)
    )
    store_results(root, CELL, rows_of(CELL, 3, first=20), (), source(elapsed=9.0))
    store_results(root, CELL, rows_of(CELL, 2, first=9), (), source(commit="b", elapsed=1.0))
    merged(command("compact", CELL.id))
    (part,) = folder.glob("part-*")
    about, table = results.read_table(part)
    assert table["trial"].to_pylist() == [*range(11), 20, 21, 22]
    assert set(table["status"].to_pylist()) == {"ok"}
    sources = [(run["trials"], run["elapsed"], run["commit"]) for run in about["sources"]]
    assert sources == [([[0, 8], [20, 22]], 9.0, "4a7f400c0ffee"), ([[9, 10]], 1.0, "b")]


@pytest.mark.parametrize("stops", range(4))
def test_compaction_that_is_killed_while_it_removes_loses_nothing(
    stops, command, cell, monkeypatch
):
    store_pictured(cell, 4)
    before = results.result_hash(read_rows(cell))
    paths = read_cell(cell).steps
    unlink = Path.unlink
    removed = []

    def killed(path: Path, missing_ok: bool = False) -> None:
        if path.suffix == ".parquet" and not path.name.startswith(files.TEMPORARY):
            if len(removed) == stops:
                raise KeyboardInterrupt
            removed.append(path)
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", killed)
    assert command("compact").code == 130
    monkeypatch.undo()
    assert len(removed) == stops
    assert results.result_hash(read_rows(cell)) == before
    assert read_cell(cell).steps.equals(paths)
    merged(command("compact"))
    assert len([*cell.glob("*.parquet")]) == 2
    assert results.result_hash(read_rows(cell)) == before


def test_what_a_run_writes_during_a_compaction_stays(command, cell, monkeypatch):
    write = compaction.write_table

    def and_a_run(*args: Any) -> Path:
        store_results(cell.parent, CELL, rows_of(CELL, 5, first=40), (), source())
        return write(*args)

    monkeypatch.setattr(compaction, "write_table", and_a_run)
    merged(command("compact"))
    assert read_rows(cell)["trial"].tolist() == [*range(25), *range(40, 45)]


def test_a_reader_sees_every_row_while_files_are_merged(cell, monkeypatch):
    before = results.result_hash(read_rows(cell))
    read = results.read_table
    calls: list[Path] = []

    def and_a_compaction(path: Path) -> Any:
        calls.append(path)
        if len(calls) == 2:
            compaction.compact(cell)
        return read(path)

    monkeypatch.setattr(results, "read_table", and_a_compaction)
    warnings: list[str] = []
    assert results.result_hash(read_rows(cell, warnings.append)) == before
    assert warnings == []


def test_a_file_that_does_not_read_back_removes_nothing(command, cell, monkeypatch):
    before = files_in(cell)
    monkeypatch.setattr(compaction, "result_hash", lambda rows: str(id(rows)))
    ended = command("compact")
    assert ended.code == 74
    assert "no file was removed" in ended.err
    assert set(before) <= set(files_in(cell))


def test_leftovers_of_killed_writers_go_after_an_hour(command, cell):
    old = cell / f"{files.TEMPORARY}a-part"
    new = cell / f"{files.TEMPORARY}b-part"
    for path in (old, new):
        path.write_bytes(b"PAR1")
    os.utime(old, (0, time.time() - 3700))
    merged(command("compact"))
    assert (old.exists(), new.exists()) == (False, True)


def test_what_cannot_be_read_or_contradicts_itself_is_left_as_it_is(command, cell, root):
    torn = cell / "part-torn.parquet"
    torn.write_bytes(b"PAR1")
    store_results(root, OTHER, rows_of(OTHER, 3), (), source())
    store_results(root, OTHER, rows_of(OTHER, 2, cost=4.0), (), source())
    before = files_in(root / OTHER.id)
    ended = command("compact")
    assert ended.code == 0
    assert torn.exists()
    assert "part-torn.parquet" in ended.err
    assert "left as it is: trials 0: two rows that differ" in ended.err
    assert files_in(root / OTHER.id) == before


def rewritten(path: Path, change: Callable[[pa.Table], pa.Table]) -> None:
    """Write another table in the place of one, with a hash that fits: as somebody who knows the
    format would.
    """
    about, table = results.read_table(path)
    results.write_table(path.parent, path.name.partition("-")[0], change(table), about["sources"])
    path.unlink()


def with_column(name: str, value: Any) -> Callable[[pa.Table], pa.Table]:
    def change(table: pa.Table) -> pa.Table:
        column = table.column_names.index(name)
        return table.set_column(
            column, name, pa.array([value] * len(table), table.schema.field(name).type)
        )

    return change


def flip(path: Path, target: int | bytes) -> None:
    content = bytearray(path.read_bytes())
    content[target if isinstance(target, int) else content.rindex(target)] ^= 1
    path.write_bytes(content)


def break_json(cell: Path) -> None:
    (cell / "timing.json").write_text((cell / "timing.json").read_text().replace("0.001", "0.002"))


def break_config(cell: Path) -> None:
    """Rows of a configuration that is not the cell's, said by a file that is whole."""
    results.write_rows(cell, rows_of(CELL, 1, first=90), {"config": OTHER.config, **source()})


def break_trials(cell: Path) -> None:
    _, table = results.read_table(min(cell.glob("part-*")))
    results.write_table(
        cell, "part", table.slice(0, 3), [{"trials": [[0, 9]], "config": CELL.config, **source()}]
    )


def break_settings(cell: Path) -> None:
    """Trials of one cell that two settings of XLA gave."""
    for trial, flag in ((90, "false"), (91, "true")):
        settings = {"settings": {"XLA_FLAGS": f"--fast={flag}"}}
        run = {"config": CELL.config, **source(), **settings}
        results.write_rows(cell, rows_of(CELL, 1, first=trial), run)


def break_path(cell: Path) -> None:
    """Another path of the same trial."""
    _, table = results.read_table(next(cell.glob("paths-*")))
    results.write_table(cell, "paths", with_column("state", [0.0, 0.0, 0.0, 0.0])(table), [])


BREAKS: dict[str, tuple[Callable[[Path], object], str]] = {
    "a value": (lambda cell: flip(min(cell.glob("part-*")), 60), "part-000000-000009"),
    "a commit": (lambda cell: flip(max(cell.glob("part-*")), b"4a7f400"), "part-000020-000024"),
    "a path": (lambda cell: flip(next(cell.glob("paths-*")), 300), "paths-000003-000003"),
    "a note": (break_json, "timing.json"),
    "a torn scene": (lambda cell: (cell / "scene.json").write_text("{"), "scene.json"),
    "another cell's file": (
        lambda cell: shutil.copy(
            next(
                store_results(
                    cell.parents[1] / "elsewhere", OTHER, rows_of(OTHER, 1), (), source()
                ).glob("part-*")
            ),
            cell,
        ),
        f"it belongs to {OTHER.id}",
    ),
    "a configuration": (break_config, "its configuration is not that of this cell"),
    "trials of no run": (break_trials, "it has trials 0..2, its runs 0..9"),
    "another result": (
        lambda cell: results.write_rows(
            cell, rows_of(CELL, 1, cost=np.nextafter(3.0, 4)), {"config": CELL.config}
        ),
        "trials 0: two rows that differ",
    ),
    "a seed": (
        lambda cell: rewritten(min(cell.glob("part-*")), with_column("seed", 5)),
        "seed [5] in its rows is not that of its configuration",
    ),
    "settings": (
        break_settings,
        'different settings: trials 90 with {"XLA_FLAGS": "--fast=false"}; '
        'trials 91 with {"XLA_FLAGS": "--fast=true"}',
    ),
    "a path without a row": (lambda cell: store_pictured(cell, 77), "trials 77 have no row"),
    "a shorter path": (
        lambda cell: rewritten(next(cell.glob("paths-*")), lambda table: table.slice(0, 2)),
        "trials 3 have not the steps that their rows say",
    ),
    "two paths": (break_path, "trials 3: two paths that differ"),
}


@pytest.mark.parametrize("what", BREAKS)
def test_verify_finds_what_is_broken(what, command, cell):
    assert (
        lines(command("verify"))[-1] == f"1 cell, {len(files_in(cell))} files checked: all is well"
    )
    change, expected = BREAKS[what]
    change(cell)
    ended = command("verify", CELL.id)
    assert ended.code == 3
    assert any(
        expected in line and line.startswith("outputs/results/belief-")
        for line in ended.out.splitlines()
    )
    assert "problem" in ended.out.splitlines()[-1]


def test_what_may_be_there_twice_is_no_problem(command, cell):
    """Rows of two runs at the same time, a failed row beside a good one."""
    store_results(
        cell.parent,
        CELL,
        rows_of(CELL, 3, first=8),
        (),
        source(started="2025-03-01T00:00:00+00:00"),
    )
    results.write_rows(
        cell, [failed_trial(4) | {"controller": "belief"}], {"config": CELL.config, **source()}
    )
    assert lines(command("verify"))[-1].endswith("files checked: all is well")


def test_times_and_sizes_in_words():
    from mppi_belief.cli.tables import bytes_in_words, time_in_words

    assert [bytes_in_words(n) for n in (0, 999, 1000, 99499, 999499, 999500, 2 * 10**12)] == [
        "0 B", "999 B", "1.0 kB", "99.5 kB", "999 kB", "1.0 MB", "2000 GB",
    ]  # fmt: skip
    assert [time_in_words(s) for s in (0, 59, 60, 7200, 86400 * 3)] == [
        "0 s",
        "59 s",
        "1 min",
        "2 h",
        "3 d",
    ]


def test_completion_of_commands_and_cells(cell, tmp_path, capsys):
    for line, expected in {
        "mppi-belief results sh": ["show"],
        "mppi-belief results ": ["show", "export", "compact", "verify", "results_dir="],
        "mppi-belief results verify bel": [cell.name],
        "mppi-belief replay ": [cell.name, "results_dir="],
        "mppi-belief replay results_dir=nowhere b": [],
    }.items():
        ended = call(
            tmp_path, capsys, "-sc", "query=bash", COMP_LINE=line, COMP_POINT=str(len(line))
        )
        assert (ended.code, ended.err, ended.out.split()) == (0, "", expected)


def test_numbers_that_are_not_there_are_not_the_same_as_others():
    from mppi_belief.results.audit import same_value

    assert same_value(math.nan, math.nan)
    assert not same_value(math.nan, 1.0)
