"""Results on disk: nothing is lost or half written, and what cannot be read is named."""

import errno
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cli_helpers import files_in
from mppi_belief.results import files
from mppi_belief.results import table as results
from mppi_belief.results.compact import compact
from mppi_belief.results.contents import path_of, read_cell, read_rows
from mppi_belief.results.provenance import provenance
from mppi_belief.results.sources import sources_of
from results_helpers import EXTREMES, bits
from study_helpers import failed_row, row


def written(folder: Path, *rows: dict) -> Path:
    """The part file of these rows."""
    before = set(folder.glob("part-*")) if folder.exists() else set()
    results.write_rows(folder, rows, {"config": {}})
    (path,) = set(folder.glob("part-*")) - before
    return path


def test_numbers_come_back_bit_for_bit(tmp_path):
    path = written(tmp_path, *(row(trial, cost=value) for trial, value in enumerate(EXTREMES)))
    assert bits(read_rows(tmp_path)["cost"].tolist()) == bits(EXTREMES)
    assert pq.read_table(path)["cost"].null_count == 0


def test_text_booleans_and_nothing_come_back(tmp_path):
    lost = failed_row({}, 1, "error", 'ValueError: "a", b\nc\t\u03b8')
    path = written(tmp_path, row(0, collided=True), lost, row(2, collided=False))
    (_, back, _) = pq.read_table(path).to_pylist()
    assert (back["collided"], back["error"], back["steps"]) == (None, lost["error"], 0)
    rows = read_rows(tmp_path)
    assert [rows["collided"][0], rows["collided"][2]] == [True, False]
    assert pd.isna(rows["collided"][1])
    assert rows["status"].tolist() == ["ok", "error", "ok"]
    assert pd.isna(rows["error"][0])
    assert rows["trial"].tolist() == [0, 1, 2]


def test_swept_settings_are_columns_of_their_own(tmp_path):
    swept = {
        "controller.horizon": 7,
        "cost.obstacle_penalty.width": 0.1,
        "cost.goal": "[1, 2]",
        "system": "light_dark",
    }
    path = written(tmp_path, row(0, **swept), row(1, **swept))
    assert {key: pq.read_table(path)[key].to_pylist() for key in swept} == {
        key: [swept[key]] * 2 for key in swept
    }
    written(tmp_path, row(2, **{"planner.horizon": 7}))
    assert read_rows(tmp_path)["trial"].tolist() == [0, 1, 2]


def test_a_file_says_where_it_comes_from(tmp_path):
    source = {
        "config": {"seed": 3, "names": {"system": "s"}},
        **provenance(["mppi-belief", "run", "theta=1"]),
    }
    results.write_rows(tmp_path, [row(0)], source)
    (path,) = tmp_path.iterdir()
    about, table = results.read_table(path)
    assert about["digest"] == results.table_digest(table)
    assert (about["format"], about["cell"]) == (results.FORMAT_VERSION, tmp_path.name)
    (stored_source,) = about["sources"]
    assert stored_source == {"trials": [[0, 0]], **source}
    assert stored_source["command"] == ["mppi-belief", "run", "theta=1"]
    assert {"python", "jax", "numpy", "mppi-belief"} <= set(stored_source["versions"])
    assert set(stored_source["threads"]) >= {"NPROC", "OMP_NUM_THREADS"}
    assert {"commit", "dirty", "platform", "processor", "started", "algorithm"} <= set(
        stored_source
    )


def test_trajectories_come_back_in_order_and_once(tmp_path):
    def steps(trial: int) -> list[dict]:
        arrays = {
            "state": [trial, 0.5],
            "mean": [1 / 3, 0],
            "cov": [1, 2, 3, 4],
            "control": [math.nan],
        }
        return [
            {
                "trial": trial,
                "step": k,
                **{key: np.array(value) * (k + 1) for key, value in arrays.items()},
            }
            for k in range(3)
        ]

    results.write_paths(tmp_path, steps(1) + steps(4))
    results.write_paths(tmp_path, steps(0))
    results.write_paths(tmp_path, steps(0) + steps(1))
    steps_read = read_cell(tmp_path).steps
    assert list(zip(steps_read["trial"], steps_read["step"], strict=True)) == [
        (t, k) for t in (0, 1, 4) for k in range(3)
    ]
    for expected, (_, got) in zip(
        [*steps(0), *steps(1), *steps(4)], steps_read.iterrows(), strict=True
    ):
        assert all(
            bits(got[key]) == bits(expected[key]) for key in ("state", "mean", "cov", "control")
        )


def test_a_path_that_is_stored_twice_is_the_one_that_merging_keeps(tmp_path):
    def steps(value: float) -> list[dict[str, Any]]:
        arrays = {name: np.full(2, value) for name in ("state", "mean", "cov", "control")}
        return [{"trial": 3, "step": k, **arrays} for k in range(2)]

    results.write_paths(tmp_path, steps(1.0))
    results.write_paths(tmp_path, steps(2.0))
    contents = read_cell(tmp_path)
    before = path_of(contents, 3)
    assert [step["step"] for step in before] == [0, 1]
    assert path_of(contents, 4) == []
    for step, (_, row_of_steps) in zip(before, contents.steps.iterrows(), strict=True):
        np.testing.assert_array_equal(step["state"], row_of_steps["state"])
    compact(tmp_path)
    after = path_of(read_cell(tmp_path), 3)
    np.testing.assert_array_equal([s["mean"] for s in before], [s["mean"] for s in after])


def test_small_files_come_back_and_a_missing_or_broken_one_is_none(tmp_path):
    content = {"seconds": [0.1, 1e-300], "text": "\u03b8"}
    files.write_json(tmp_path, "timing", content)
    assert files.read_json(tmp_path, "timing") == content
    (tmp_path / "scene.json").write_text('{"dt": 0.')
    assert files.read_json(tmp_path, "scene") is None
    assert files.read_json(tmp_path, "nothing") is None
    changed = (tmp_path / "timing.json").read_text().replace("0.1", "0.2")
    (tmp_path / "timing.json").write_text(changed)
    assert files.read_json(tmp_path, "timing") is None


def test_a_folder_without_results_has_no_rows(tmp_path):
    for folder in (tmp_path, tmp_path / "missing"):
        assert read_rows(folder).empty
        assert read_cell(folder).steps.empty
        assert list(read_rows(folder)["trial"]) == []


@pytest.mark.parametrize("old", [False, True])
def test_a_failing_write_leaves_no_trace_and_the_old_file_as_it_was(old, tmp_path, monkeypatch):
    if old:
        written(tmp_path, row(0))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def full_disk(table: pa.Table, path: Path, **options: str) -> None:
        path.write_bytes(b"PAR1 and some more")
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(pq, "write_table", full_disk)
    with pytest.raises(OSError, match="No space left"):
        results.write_rows(tmp_path, [row(0, cost=99.0)], {})
    with pytest.raises(OSError, match="No space left"):
        results.write_paths(tmp_path, [{"trial": 0, "step": 0, "state": np.zeros(2)}])
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_leftovers_of_a_killed_writer_are_ignored(tmp_path):
    path = written(tmp_path, row(0))
    (tmp_path / f".tmp-99999-{path.name}").write_bytes(path.read_bytes()[:40])
    warnings: list[str] = []
    assert read_rows(tmp_path, warnings.append)["trial"].tolist() == [0]
    assert warnings == []


def test_of_a_trial_found_twice_the_good_row_counts(tmp_path):
    bad = failed_row({}, 1, "crashed", "gone")
    written(tmp_path, bad, row(2, cost=5.0))
    written(tmp_path, row(1, cost=7.0), row(3), row(4))
    written(tmp_path, failed_row({}, 3, "error", "oh"), failed_row({}, 5, "error", "oh"))
    rows = read_rows(tmp_path)
    assert rows["trial"].tolist() == [1, 2, 3, 4, 5]
    assert rows["status"].tolist() == ["ok"] * 4 + ["error"]
    assert rows["cost"].tolist()[:2] == [7.0, 5.0]
    assert set(rows.columns) == set(row(0))


def test_what_is_no_results_file_is_named_and_left_out(tmp_path):
    path = written(tmp_path, row(0), row(1))
    (tmp_path / "part-empty.parquet").touch()
    (tmp_path / "part-torn.parquet").write_bytes(path.read_bytes()[:-20])
    (tmp_path / "part-noise.parquet").write_bytes(b"PAR1" + bytes(range(256)) + b"PAR1")
    pq.write_table(
        pa.table({"trial": [7], "note": ["not ours"]}), tmp_path / "part-foreign.parquet"
    )
    warnings: list[str] = []
    assert read_rows(tmp_path, warnings.append)["trial"].tolist() == [0, 1]
    for name in ("empty", "torn", "noise", "foreign"):
        (line,) = [line for line in warnings if f"part-{name}.parquet" in line]
        assert "left out" in line
        assert len(line.splitlines()) == 1
    assert len(warnings) == 4


@pytest.mark.parametrize("part", range(1, 10))
def test_a_damaged_byte_changes_nothing_or_is_noticed(part, tmp_path):
    path = written(tmp_path, *(row(trial) for trial in range(50)))
    before = results.result_hash(read_rows(tmp_path))
    content = bytearray(path.read_bytes())
    content[len(content) * part // 10] ^= 1
    path.write_bytes(content)
    warnings: list[str] = []
    rows = read_rows(tmp_path, warnings.append)
    assert len(warnings) == 1 if rows.empty else results.result_hash(rows) == before


def test_changed_values_in_a_whole_file_are_noticed(tmp_path):
    path = written(tmp_path, row(0, cost=1.0), row(1))
    table = pq.read_table(path)
    position = table.column_names.index("cost")
    pq.write_table(table.set_column(position, "cost", pa.array([0.5, 4.0])), path)
    assert pq.read_table(path).schema.metadata
    warnings: list[str] = []
    assert read_rows(tmp_path, warnings.append).empty
    assert "not those that were written" in warnings[0]


def test_a_file_of_another_cell_or_of_another_format_is_named_and_left_out(tmp_path, monkeypatch):
    mine, foreign, newer = (tmp_path / name for name in ("mine", "other", "newer"))
    path = written(mine, row(0), row(1))
    foreign.mkdir()
    (foreign / path.name).write_bytes(path.read_bytes())
    monkeypatch.setattr(results, "FORMAT_VERSION", results.FORMAT_VERSION + 1)
    written(newer, row(0))
    monkeypatch.undo()
    warnings: list[str] = []
    assert [len(read_rows(folder, warnings.append)) for folder in (mine, foreign, newer)] == [
        2,
        0,
        0,
    ]
    assert [word in line for word, line in zip(("mine", "newer"), warnings, strict=True)] == [
        True,
        True,
    ]


def test_paths_that_are_torn_or_not_ours_are_named_and_left_out(tmp_path):
    steps = [
        {
            "trial": 2,
            "step": k,
            **{name: np.full(2, float(k)) for name in ("state", "mean", "cov", "control")},
        }
        for k in range(3)
    ]
    results.write_paths(tmp_path, steps)
    (path,) = tmp_path.glob("paths-*")
    (tmp_path / "paths-torn.parquet").write_bytes(path.read_bytes()[:-20])
    (tmp_path / "paths-empty.parquet").touch()
    pq.write_table(
        pa.table({"trial": [7], "step": [0], "state": [[1.0]]}), tmp_path / "paths-foreign.parquet"
    )
    written(tmp_path, row(0))  # a table of another kind
    contents = read_cell(tmp_path)
    steps_read = contents.steps
    warnings = contents.problems
    assert list(zip(steps_read["trial"], steps_read["step"], strict=True)) == [
        (2, 0),
        (2, 1),
        (2, 2),
    ]
    assert [*steps_read.columns] == ["trial", "step", "state", "mean", "cov", "control"]
    assert [
        name
        for name in ("empty", "foreign", "torn")
        if any(f"paths-{name}.parquet" in w for w in warnings)
    ] == [
        "empty",
        "foreign",
        "torn",
    ]
    assert len(warnings) == 3
    assert all("left out" in line and len(line.splitlines()) == 1 for line in warnings)
    path.unlink()
    assert read_cell(tmp_path).steps.empty


def test_sources_are_those_of_the_files_that_can_be_read_and_hold_these_trials(tmp_path):
    assert sources_of(read_cell(tmp_path / "missing"), range(9)) == []
    for trial, commit in ((5, "b"), (0, "a")):
        results.write_rows(tmp_path, [row(trial)], {"commit": commit, "elapsed": 1.5})
    (path, _) = sorted(tmp_path.glob("part-*"))
    files.write_json(tmp_path, "timing", {"seconds": []})
    (tmp_path / "part-torn.parquet").write_bytes(path.read_bytes()[:-20])
    (tmp_path / "part-empty.parquet").touch()
    pq.write_table(pa.table({"trial": [7]}), tmp_path / "part-foreign.parquet")
    described = pa.schema([("trial", pa.int64())], metadata={b"mppi-belief": b"{no json"})
    pq.write_table(pa.table({"trial": [7]}, schema=described), tmp_path / "part-garbled.parquet")
    foreign = pa.schema([("trial", pa.int64())], metadata={b"pandas": b"{}"})
    pq.write_table(pa.table({"trial": [7]}, schema=foreign), tmp_path / "part-pandas.parquet")
    listed = pa.schema([("trial", pa.int64())], metadata={b"mppi-belief": b"[]"})
    pq.write_table(pa.table({"trial": [7]}, schema=listed), tmp_path / "part-listed.parquet")
    first, second = (
        {"trials": [[trial, trial]], "commit": commit, "elapsed": 1.5}
        for trial, commit in ((0, "a"), (5, "b"))
    )
    assert sources_of(read_cell(tmp_path), range(9)) == [first, second]
    assert sources_of(read_cell(tmp_path), range(5)) == [first]
    assert sources_of(read_cell(tmp_path), [5]) == [second]


def test_a_place_that_can_be_written_is_made_and_left_empty(tmp_path):
    files.probe(tmp_path / "a" / "b")
    assert files_in(tmp_path / "a" / "b") == []
    with pytest.raises(OSError):
        files.probe(Path("/dev/null/x"))


def table(**changes: object) -> pd.DataFrame:
    return pd.DataFrame([row(0) | changes, row(1), failed_row({}, 2, "error", "oh")])


OTHERS = {
    "trial": 5,
    "seed": 1,
    "status": "diverged",
    "controller": "ce",
    "theta": 0.0,
    "w_obs": 501.0,
    "cost": np.nextafter(3.0, 4),
    "running_cost": np.nextafter(2.0, 0),
    "terminal_cost": -1.0,
    "collided": True,
    "clearance": math.nan,
    "final_distance": math.inf,
    "ess": 8.5,
    "nees": 4.0,
    "nis": math.nan,
    "steps": 4,
    "error": "oh",
}


@pytest.mark.parametrize("column", OTHERS)
def test_the_hash_changes_with_any_value(column):
    assert set(OTHERS) == set(row(0))
    assert results.result_hash(table(**{column: OTHERS[column]})) != results.result_hash(table())


def test_the_hash_tells_a_zero_from_a_negative_zero_and_a_text_from_its_beginning():
    assert results.result_hash(table(cost=0.0)) != results.result_hash(table(cost=-0.0))
    assert results.result_hash(table(error="a,b")) != results.result_hash(table(error="a"))


def test_the_hash_tells_an_empty_text_from_none():
    assert results.result_hash(table(error="")) != results.result_hash(table(error=None))


def test_the_hash_does_not_depend_on_order_files_or_other_columns(tmp_path):
    rows = [row(trial, cost=value, horizon=7) for trial, value in enumerate(EXTREMES)]
    rows.append(failed_row({}, 9, "error", "oh") | {"horizon": 7})
    written(tmp_path / "a", *rows)
    written(tmp_path / "b", *rows[5:])
    written(tmp_path / "b", *rows[:5][::-1])
    hashes = {results.result_hash(read_rows(tmp_path / name)) for name in "ab"}
    hashes.add(results.result_hash(pd.DataFrame(rows[::-1])))
    assert len(hashes) == 1
