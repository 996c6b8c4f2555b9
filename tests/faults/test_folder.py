"""A results folder with what should not be in it: told by name, left alone, and not counted."""

import json

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cli_helpers import collect
from faults_helpers import N_TRIALS, SMALL, Run
from mppi_belief.config import cell as cell_identity
from mppi_belief.results import table as results
from mppi_belief.results.contents import read_rows


@pytest.fixture
def run(tmp_path, undisturbed) -> Run:
    """A study that is done."""
    run = Run(tmp_path)
    for path in undisturbed.root.rglob("*"):
        if path.is_file():
            copy = run.root / path.relative_to(undisturbed.root)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(path.read_bytes())
    return run


@pytest.mark.long
def test_truncated_empty_and_foreign_files_cost_their_own_trials_only(run, undisturbed):
    truncated = max(run.parts(), key=lambda path: path.stat().st_size)
    lost = len(results.read_table(truncated)[1])
    truncated.write_bytes(truncated.read_bytes()[:-100])
    cell = truncated.parent
    (cell / "part-000000-000009-empty.parquet").touch()
    pq.write_table(
        pa.table({"trial": [1, 2, 3], "cost": [1.0, 2.0, 3.0]}),
        cell / "part-000001-000003-foreign.parquet",
    )
    (cell / "part-000000-000009-text.parquet").write_text("not parquet at all\n")
    ended = run.again()
    assert ended.code == 0, ended.err
    assert f"{lost} trials run, {4 * N_TRIALS - lost} already done" in ended.out
    for name in (truncated.name, "empty", "foreign", "text"):
        (line,) = {line for line in ended.err.splitlines() if name in line}
        assert line.startswith(f"{cell.relative_to(run.folder)}/part-")
        assert "not a results file of this cell, left out" in line
    assert "Traceback" not in ended.err
    hashes = {cell.name: results.result_hash(read_rows(cell)) for cell in run.root.iterdir()}
    assert hashes == undisturbed.hashes


@pytest.mark.long
def test_files_of_another_format_are_named_and_left_out(run, undisturbed):
    cell = min(run.root.iterdir())
    refused = 0
    for path in cell.glob("part-*"):
        metadata, table = results.read_table(path)
        refused += len(table)
        restate(path, table, {**metadata, "format": results.FORMAT_VERSION + 1})
    ended = run.again()
    assert ended.code == 0, ended.err
    assert f"{refused} trials run, {4 * N_TRIALS - refused} already done" in ended.out
    assert f"its format is {results.FORMAT_VERSION + 1}, must be" in ended.err
    hashes = {cell.name: results.result_hash(read_rows(cell)) for cell in run.root.iterdir()}
    assert hashes == undisturbed.hashes


def restate(path, table: pa.Table, about: dict) -> None:
    pq.write_table(table.replace_schema_metadata({b"mppi-belief": json.dumps(about)}), path)


def test_results_of_another_algorithm_are_in_other_folders(monkeypatch):
    """The same configuration, when it would give other numbers, is another cell: what is there does
    not count.
    """
    (config,) = collect(*SMALL)
    now = cell_identity.Cell(config).id
    assert cell_identity.Cell(config).id == now
    monkeypatch.setattr(cell_identity, "ALGORITHM_VERSION", cell_identity.ALGORITHM_VERSION - 1)
    assert cell_identity.Cell(config).id != now
