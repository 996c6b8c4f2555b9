"""`mppi-belief replay`: a trial comes out the same bit for bit, and what does not is told."""

import math
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from cli_helpers import SMALL, Said, call, compose, files_in
from experiment_helpers import compiled_quickly
from mppi_belief.cli.overview import replay_command
from mppi_belief.cli.replayed_trial import changes_since
from mppi_belief.config.cell import ALGORITHM_VERSION, Cell
from mppi_belief.results import table as results
from mppi_belief.trial import run_trials, trials
from mppi_belief.trial.rerun import differences, finite_steps, ulps
from study_helpers import row

RUN = {
    "command": ["mppi-belief", "run"],
    "started": "2025-01-01T10:00:00+00:00",
    "algorithm": ALGORITHM_VERSION,
}


@pytest.fixture(scope="module")
def ran() -> tuple[Cell, Any]:
    """Three trials of a small problem."""
    cell = Cell(compose(*SMALL))
    with compiled_quickly():
        return cell, run_trials(cell.config, [0, 1, 60], path_limit=2)


@pytest.fixture
def cell_folder(ran, tmp_path) -> Path:
    """What a run leaves of them."""
    cell, batch = ran
    folder = tmp_path / "outputs" / "results" / cell.id
    results.write_paths(folder, batch.paths)
    results.write_rows(folder, batch.rows, {"config": cell.config, **RUN})
    return folder


@pytest.fixture
def replay(tmp_path, capsys) -> Callable[..., Said]:
    """The command, in this process and a folder of its own."""

    def run(*args: str) -> Said:
        with compiled_quickly():
            return call(tmp_path, capsys, "replay", *args)

    return run


def change(folder: Path, kind: str, name: str, index: int, value: Any, **about: Any) -> None:
    """One value of a file becomes another, with a hash that fits."""
    (path,) = folder.glob(f"{kind}-*")
    metadata, table = results.read_table(path)
    values = table[name].to_pylist()
    values[index] = value
    column = table.column_names.index(name)
    table = table.set_column(column, name, pa.array(values, table.schema.field(name).type))
    path.unlink()
    results.write_table(folder, kind, table, [source | about for source in metadata["sources"]])


def test_a_trial_is_reproduced_bit_for_bit_and_drawn(replay, cell_folder):
    ended = replay(cell_folder.name, "1")
    assert (ended.code, ended.err) == (0, "")
    assert "reproduced bit for bit: 21 values of its row, 4 steps of its path" in ended.out
    assert f"picture: outputs/results/{cell_folder.name}/replay-1.png" in ended.out
    assert (cell_folder / "replay-1.png").read_bytes().startswith(b"\x89PNG")


def test_a_trial_without_a_kept_path_is_reproduced_and_drawn_too(replay, cell_folder):
    ended = replay(cell_folder.name[:9], "60", "results_dir=outputs/results")
    assert ended.code == 0
    assert "reproduced bit for bit: 21 values of its row, no path was kept" in ended.out
    assert (cell_folder / "replay-60.png").exists()


def test_a_value_of_the_row_in_its_last_digit_is_told(replay, cell_folder, ran):
    cost = ran[1].rows[0]["cost"]
    changed = float(np.nextafter(np.float32(cost), np.float32(math.inf)))
    change(cell_folder, "part", "cost", 0, changed)
    ended = replay(cell_folder.name, "0")
    assert ended.code == 3
    assert f"cost: {changed!r}, now {cost!r}; 1 ulp of float32 apart\n" in ended.out
    assert "NOT reproduced" in ended.out


def test_a_value_of_the_path_is_told_with_its_place(replay, cell_folder, ran):
    mean = ran[1].paths[2]["mean"]
    change(cell_folder, "paths", "mean", 2, [float(mean[0]) + 1.0])
    ended = replay(cell_folder.name, "0")
    assert ended.code == 3
    assert "mean at step 2, component 0, the first of 1: " in ended.out
    assert "state" not in ended.out


def test_what_is_not_as_it_was_is_told_in_one_line(replay, cell_folder):
    change(
        cell_folder,
        "part",
        "seed",
        0,
        0,
        versions={"jaxlib": "0.1", "jax": "0.2"},
        processor="Z80",
        commit="a" * 40,
    )
    ended = replay(cell_folder.name, "1")
    assert ended.code == 0
    (line,) = (line for line in ended.out.splitlines() if line.startswith("not as it was then: "))
    assert "python" not in line
    assert all(
        text in line
        for text in (
            "jaxlib 0.1, now ",
            "jax 0.2, now ",
            "processor Z80, now ",
            "commit aaaaaaa, now",
        )
    )


def test_a_crashed_trial_is_run_only_by_force(replay, cell_folder):
    change(cell_folder, "part", "status", 0, "crashed")
    ended = replay(cell_folder.name, "0")
    assert (ended.code, ended.out) == (2, "")
    assert "--force" in ended.err
    forced = replay(cell_folder.name, "0", "--force")
    assert forced.code == 3
    assert "status: 'crashed', now 'ok'" in forced.out


def test_a_failed_trial_must_fail_the_same_way(replay, ran, tmp_path, monkeypatch):
    def unlucky(*args: Any) -> None:
        raise RuntimeError("no plan survives\nthe first step")

    monkeypatch.setattr(trials, "simulate_and_judge", unlucky)
    cell = ran[0]
    batch = run_trials(cell.config, [0])
    folder = tmp_path / "outputs" / "results" / cell.id
    results.write_rows(folder, batch.rows, {"config": cell.config, **RUN})
    ended = replay(cell.id, "0")
    assert ended.code == 0
    assert ended.err.startswith("Traceback (most recent call last)")
    assert ended.err.endswith("RuntimeError: no plan survives\nthe first step\n")
    assert ": error, " in ended.out
    assert ended.out.endswith("no picture: it has no path\n")
    assert len(files_in(folder)) == 1
    change(folder, "part", "error", 0, "another one")
    again = replay(cell.id, "0")
    assert again.code == 3
    assert "error: 'another one', now 'RuntimeError: no plan survives" in again.out


def test_code_named_in_a_results_folder_is_looked_for_where_the_user_says_and_nowhere_else(
    replay, tmp_path, ran
):
    mine = tmp_path / "mine"
    flag = tmp_path / "imported"
    mine.mkdir()
    for folder in (mine, tmp_path):
        (folder / "planted_part.py").write_text(f"open({str(flag)!r}, 'w').close()\n")
    cell = Cell(compose(*SMALL) | {"controller": {"_target_": "planted_part.Part"}})
    source = RUN | {
        "command": ["mppi-belief", "run", "--config-dir", str(mine)],
        "import_paths": [str(mine)],
    }
    results.write_rows(
        tmp_path / "outputs" / "results" / cell.id, ran[1].rows, {"config": cell.config, **source}
    )
    ended = replay(cell.id, "0")
    assert ended.code == 2
    assert "of a module in a --config-dir folder" in ended.err
    assert not flag.exists()
    assert replay(cell.id, "0", "--config-dir", str(mine)).code == 2  # it has no Part
    assert flag.exists()


def test_the_command_that_a_run_prints_works_beside_other_cells(replay, cell_folder, ran):
    _, batch = ran
    last_digit = "1" if cell_folder.name.endswith("0") else "0"
    similar = cell_folder.with_name(cell_folder.name[:-1] + last_digit)
    results.write_rows(similar, batch.rows, {"config": {}, **RUN})
    printed = replay_command(cell_folder.name, 1, Path("outputs/results"), ())
    assert printed == f"mppi-belief replay {cell_folder.name} 1"
    assert replay(*shlex.split(printed)[2:]).code == 0

    # The beginning that both share.
    ambiguous = replay("belief", "1")
    assert ambiguous.code == 2
    both = ", ".join(sorted([cell_folder.name, similar.name]))
    assert f"several cells begin with 'belief': {both}; name one of them in full" in ambiguous.err
    assert "mppi-belief results results_dir=outputs/results shows their" in ambiguous.err


def test_the_printed_command_names_folders_as_a_shell_takes_them():
    printed = replay_command("ce-0123456789ab", 17, Path("out (1)"), ["my parts"])
    words = ["ce-0123456789ab", "17", "results_dir=out (1)", "--config-dir", "my parts"]
    assert shlex.split(printed) == ["mppi-belief", "replay", *words]


BAD = {
    "": "name a cell and a trial",
    "CELL": "name a cell and a trial",
    "CELL 7": "it has 3 trials, 0 to 60",
    "CELL -1": "unknown option '-1'",
    "CELL one": "must be a whole number",
    "nothing 0": "unknown cell 'nothing'",
    "CELL 0 theta=1": "unknown key 'theta'",
    "CELL 0 --config-dir": "needs a value",
}


@pytest.mark.parametrize("line", BAD)
def test_bad_input_is_one_line(line, replay, cell_folder):
    ended = replay(*line.replace("CELL", cell_folder.name).split())
    assert (ended.code, ended.out, ended.err.count("\n")) == (2, "", 1)
    assert BAD[line] in ended.err


@pytest.mark.parametrize("key", ["platform", "seed"])
def test_a_configuration_that_is_not_the_cells_is_not_run(key, replay, cell_folder, ran):
    config = {name: value for name, value in ran[0].config.items() if name != key}
    change(
        cell_folder, "part", "seed", 0, 0, config=config | ({"seed": 4} if key == "seed" else {})
    )
    ended = replay(cell_folder.name, "0")
    assert (ended.code, ended.out) == (2, "")
    assert ("not that of this cell" if key == "seed" else "says nothing of 'platform'") in ended.err


def test_distances_in_ulp():
    unit = np.float32(1.0)
    assert ulps(1.0, float(np.nextafter(unit, np.float32(2))), "float32") == 1
    assert ulps(1.0, float(np.nextafter(1.0, 2)), "float64") == 1
    assert ulps(-5e-324, 5e-324, "float64") == 2
    assert ulps(2.0, 1.0, "float32") == 2**23
    assert ulps(1.0, math.nan, "float32") is None
    assert ulps(0.0, -0.0, "float64") == 0


def test_differences_are_of_bits():
    def named(then: dict[str, Any], now: dict[str, Any]) -> list[str]:
        return [difference.name for difference in differences(then, now, [], [], "float32")]

    assert named(row(0, cost=math.nan, theta=1), row(0, cost=math.nan, theta=1.0)) == []
    assert named(row(0, cost=0.0), row(0, cost=-0.0)) == ["cost"]
    assert named(row(0), row(0, collided=True, steps=4, error="oh")) == [
        "collided",
        "steps",
        "error",
    ]
    assert named(row(0, nees=None, nis=2.0), row(0, nees=4.0, nis=3.0)) == ["nees", "nis"]
    assert named(row(0, nees=math.nan, collided=None), row(0, nees=4.0, collided=True)) == [
        "collided",
        "nees",
    ]
    step = {
        "step": 0,
        "state": np.zeros(2),
        "mean": np.zeros(2),
        "cov": np.eye(2).ravel(),
        "control": np.full(1, np.nan),
    }
    moved = step | {"step": 1, "state": np.array([0.0, 5e-324]), "cov": np.zeros(3)}
    path = [step, step | {"step": 1}]
    assert differences({}, {}, path, [step, step], "float64") == []
    (difference,) = differences({}, {}, path, [step, step | {"state": moved["state"]}], "float64")
    assert (difference.name, difference.location, difference.ulp, difference.values) == (
        "state",
        "step 1, component 1",
        1,
        1,
    )
    assert [d.name for d in differences({}, {}, [step], [moved], "float64")] == ["state", "cov"]
    assert [d.name for d in differences({}, {}, [step], [step, moved], "float64")] == [
        "steps of the path"
    ]


def test_a_picture_ends_where_the_numbers_do():
    step = {"state": np.zeros(2), "mean": np.zeros(2), "cov": np.zeros(4)}
    assert len([*finite_steps([step, step, step | {"cov": np.full(4, np.inf)}, step])]) == 2


def test_code_that_has_changed_since_is_told():
    now = {
        "versions": dict.fromkeys(("python", "jax", "jaxlib", "numpy", "mppi-belief"), "1"),
        "threads": {},
    }
    now |= dict.fromkeys(("algorithm", "processor", "platform", "device"), "same")
    then = {"config": {"code": {"mine": "aa", "yours": "cc"}}}
    assert changes_since(then, now | {"code": {"mine": "bb", "yours": "cc"}}) == [
        "code of mine aa, now bb"
    ]
