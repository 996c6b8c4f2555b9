"""The script of docs/cluster.md for a job array, with the variables that Slurm would set."""

import os
import re
import subprocess
from pathlib import Path

import pytest

from mppi_belief.errors import ConfigError
from mppi_belief.run.plan import Shard

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "cluster.md").read_text()
(SCRIPT,) = re.findall(r"<!-- array -->\n```bash\n(.*?)```", PAGE, re.S)
TASKS = 20  # of the script's `--array`


@pytest.fixture
def words_of_task(tmp_path):
    """Returns the words that a task of the array gives to `mppi-belief`."""
    program = tmp_path / "mppi-belief"
    program.write_text('#!/bin/sh\nprintf "%s\\n" "$@"\n')
    program.chmod(0o755)

    def run(task: int, submitted_together: int) -> list[str]:
        variables = {
            "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}",
            "SLURM_ARRAY_TASK_ID": str(task),
            "SLURM_ARRAY_TASK_COUNT": str(submitted_together),
            "SLURM_ARRAY_TASK_MIN": str(task),
            "SLURM_ARRAY_TASK_MAX": str(task),
            "SLURM_CPUS_PER_TASK": "5",
        }
        done = subprocess.run(
            ["bash", "-c", SCRIPT, "array.sh", "-m", "controller=belief,ce", "n_trials=20"],
            env=variables,
            capture_output=True,
            text=True,
            timeout=30,
            check=True,
        )
        return done.stdout.splitlines()

    return run


@pytest.mark.parametrize("submitted_together", [TASKS, 2, 1])
def test_a_task_runs_the_same_shard_however_many_are_submitted_with_it(
    words_of_task, submitted_together
):
    words = words_of_task(3, submitted_together)
    study = ["-m", "controller=belief,ce", "n_trials=20"]
    assert words == ["run", *study, f"shard=3/{TASKS}", "workers=5"]


def test_the_tasks_of_the_script_are_all_its_shards():
    first, last = re.search(r"--array=(\d+)-(\d+)", SCRIPT).groups()
    assert (int(first), int(last)) == (1, TASKS)


def test_a_shard_beyond_the_last_says_what_is_counted():
    with pytest.raises(ConfigError, match=r"shard=3/2: .*n counts all parts of the study"):
        Shard.parse("3/2")
