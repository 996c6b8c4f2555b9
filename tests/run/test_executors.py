"""Which workers a study gets, and what is said where a setting makes no sense."""

import re
from importlib.util import find_spec
from pathlib import Path

import pytest

from cli_helpers import SMALL, call, collect, files_in
from mppi_belief.config.cell import Cell
from mppi_belief.config.executors import (
    DaskExecutor,
    LocalExecutor,
    SlurmExecutor,
    read_executor,
)
from mppi_belief.errors import ConfigError
from mppi_belief.run import start_workers
from mppi_belief.run.dask import DaskWorkers
from mppi_belief.run.local import LocalWorkers
from mppi_belief.run.start_workers import make_workers
from mppi_belief.run.worker import WorkerSetup

BAD = [
    "executor=slrum",
    "executor.kind=pbs",
    "executor.address=tcp://host:1",
    "executor=dask executor.address=[1]",
    "executor=dask executor.patience=soon",
    "executor=dask executor.patience=-1",
    "executor=dask +executor.ports=1",
    "executor=slurm executor.memory=much",
    "executor=slurm executor.walltime=90",
    "executor=slurm executor.walltime=tomorrow",
    "executor=slurm executor.workers_per_job=0",
    "executor=slurm executor.workers_per_job=1.5",
    "executor=slurm executor.directives=--x",
    "-m executor=local,dask",
    "shard=0/3",
    "shard=4/3",
    "shard=1",
    "shard=a/b",
    "-m shard=1/2,2/2",
    "trial_timeout=0",
    "trial_timeout=never",
]


@pytest.mark.parametrize("line", BAD)
def test_bad_settings_are_one_line_and_leave_no_trace(line, tmp_path, capsys):
    ended = call(tmp_path, capsys, "run", *SMALL, *line.split())
    assert (ended.code, ended.out) == (2, "")
    assert re.fullmatch(r"mppi-belief: \S.*\n", ended.err)
    assert files_in(tmp_path) == []


def test_every_option_of_the_group_is_read_and_says_all_its_settings():
    settings_by_name = {
        name: read_executor(collect(f"executor={name}")[0]["executor"])
        for name in ("local", "dask", "slurm")
    }
    assert settings_by_name == {
        "local": LocalExecutor(),
        "dask": DaskExecutor(),
        "slurm": SlurmExecutor(),
    }
    for name, settings in settings_by_name.items():
        (config,) = collect(f"executor={name}")
        assert {*config["executor"]} == {"kind", *settings.__dataclass_fields__}


def test_settings_reach_the_executor():
    args = [
        "executor=slurm",
        "executor.partition=long",
        "executor.memory=1.5GB",
        "executor.directives=[-x,-y]",
    ]
    settings = read_executor(collect(*args, "executor.walltime=2-00:00:00")[0]["executor"])
    assert settings == SlurmExecutor(
        partition="long", memory="1.5GB", directives=["-x", "-y"], walltime="2-00:00:00"
    )


def test_who_works_is_no_part_of_a_cells_identity():
    cells = [
        Cell(collect(*args)[0])
        for args in ([], ["executor=slurm"], ["shard=2/5"], ["trial_timeout=3"])
    ]
    assert len({cell.id for cell in cells}) == 1
    (config,) = collect(
        "executor=dask", "executor.address=tcp://h:1", "shard=2/5", "trial_timeout=3"
    )
    assert config["swept"] == {}


def test_nothing_is_started_before_it_is_needed(monkeypatch):
    def never(*args: object) -> None:
        raise AssertionError("too early")

    monkeypatch.setattr(start_workers, "connect_dask", never)
    monkeypatch.setattr(start_workers, "connect_slurm", never)
    setup = WorkerSetup(["here"], {"JAX_PLATFORMS": "cuda"})
    local = make_workers({"kind": "local"}, 3, setup, {})
    assert isinstance(local, LocalWorkers)
    assert (local.count, local.own_environment) == (3, True)
    for kind in ("dask", "slurm"):
        workers = make_workers({"kind": kind}, 4, setup, {"NPROC": "1", "JAX_PLATFORMS": "cpu"})
        assert isinstance(workers, DaskWorkers)
        assert (workers.count, workers.own_environment) == (4, True)
        workers.close()
        with pytest.raises(AssertionError, match="too early"):
            workers.room()


@pytest.mark.parametrize("kind", ["dask", "slurm"])
def test_a_missing_extra_is_named(kind, monkeypatch):
    monkeypatch.setattr(
        "mppi_belief.run.start_workers.find_spec",
        lambda name: None if "da" in name or "dist" in name else find_spec(name),
    )
    with pytest.raises(ConfigError, match=r"pip install .*\[cluster\]"):
        make_workers({"kind": kind}, 1, WorkerSetup([], {}), {})


def test_a_scheduler_that_does_not_answer_is_exit_code_75_and_nothing_is_written(tmp_path, capsys):
    args = ["executor=dask", "executor.address=tcp://127.0.0.1:1", "executor.patience=0.2"]
    ended = call(tmp_path, capsys, "run", *SMALL, *args)
    assert (ended.code, ended.out) == (75, "")
    assert "no scheduler answers" in ended.err.splitlines()[-1]
    assert "Traceback" not in ended.err
    assert files_in(tmp_path) == []
    assert Path(tmp_path).is_dir()
